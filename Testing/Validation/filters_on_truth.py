"""The product's filters on the reference flow, and how far they are from it."""

import numpy as np
from rimflow import options, pipeline, process
from rimflow.vtkRIMFlowFilters import vtkOmni3DPressure, vtkSurfaceForce
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkPolyData


def image_of(sphere, axes, truth):
    """A truth grid as the filters take it: Velocity, MaterialAcceleration, Pressure, PressureGradient and Mask."""
    image = vtkImageData()
    image.SetDimensions(*map(len, axes))
    image.SetSpacing(*(axis[1] - axis[0] for axis in axes))
    image.SetOrigin(*(axis[0] for axis in axes))
    in_order = lambda array: np.ascontiguousarray(array.ravel(order="F"))
    fluid = ~truth["mask"]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
    gradient = np.zeros(points.shape)
    gradient[fluid] = sphere.pressure_gradient(points[fluid], sphere.reference_time)
    vectors = {"Velocity": "u v w", "MaterialAcceleration": "ax ay az"}
    arrays = {name: np.stack([in_order(truth[key]) for key in keys.split()], 1) for name, keys in vectors.items()}
    arrays["PressureGradient"] = np.stack([in_order(gradient[..., i]) for i in range(3)], 1)
    arrays["Pressure"] = in_order(truth["p"])
    for name, values in arrays.items():
        pipeline.add_array(image.GetPointData(), name, values.astype(np.float32))
    pipeline.add_array(image.GetPointData(), "Mask", in_order(truth["mask"]).astype(np.uint8))
    return image


def array_of(image, name):
    return vtk_to_numpy(image.GetPointData().GetArray(name)).astype(float)


def nodes_of(image):
    """Positions (n, 3), x fastest."""
    axes = [o + h * np.arange(n) for o, h, n in zip(image.GetOrigin(), image.GetSpacing(), image.GetDimensions())]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    return np.stack([x.ravel(), y.ravel(), z.ravel()], 1)


def body_data(diameter, centre, velocity):
    data = vtkPolyData()
    for name, values in (("Diameter", [diameter]), ("Centre", [centre]), ("Velocity", [velocity])):
        pipeline.add_array(data.GetFieldData(), name, np.array(values, float))
    return data


def balance_of(sphere, forces):
    """The numbers of vtkSurfaceForce's table as Cd and its parts, and the side force over the true force."""
    scale = 0.5 * sphere.density * sphere.speed**2 * np.pi * sphere.radius**2
    vector = lambda name: np.array([forces[f"{name}_{axis}_N"] for axis in "xyz"])
    pressure, friction, volume = vector("Fp"), vector("Fv"), vector("Fcv")
    drag = lambda force: -force @ sphere.direction / scale
    true = sphere.flow.drag_coefficients.sum()
    side = lambda force: np.linalg.norm(force - (force @ sphere.direction) * sphere.direction) / (scale * true)
    return {
        "Cd": drag(pressure + friction),
        "Cd_cv": drag(volume),
        "Cd_p": drag(pressure),
        "Cd_v": drag(friction),
        "side": side(pressure + friction),
        "side_cv": side(volume),
        "Cd_true": true,
    }


def outside(sphere, points, time, distance):
    return np.linalg.norm(points - sphere.centre_at(time), axis=1) > sphere.radius + distance


def relative_error(found, true):
    return np.sqrt(np.mean((found - true) ** 2) / np.mean(true**2))


def pressure_error(sphere, image, time, distance):
    """rms error over rms of the true pressure at the nodes farther than `distance` from the wall, both without their mean there."""
    points = nodes_of(image)
    judged = outside(sphere, points, time, distance) & (array_of(image, "Mask") == 0)
    true, found = sphere.pressure(points[judged], time), array_of(image, "Pressure")[judged]
    return relative_error(found - found.mean(), true - true.mean())


class ExactFields:
    """Pressure and force filters on images, with the fluid of a MovingSphere."""

    def __init__(self, sphere):
        self.omni, self.surface, self.errors = vtkOmni3DPressure(), vtkSurfaceForce(), pipeline.Errors()
        for algorithm in (self.omni, self.surface):
            algorithm.SetDensity(sphere.density)
            algorithm.SetViscosity(sphere.viscosity)
        self.errors.watch(self.omni, self.surface)
        self.body = body_data(sphere.diameter, sphere.centre, sphere.velocity_of_sphere)

    def pressure(self, image):
        self.omni.SetInputData(0, image)
        self.omni.SetInputDataObject(1, self.body)
        self.omni.Update()
        self.errors.check()
        result = vtkImageData()
        result.ShallowCopy(self.omni.GetOutput())
        return result

    def forces(self, image):
        """The numbers of the force table by their names."""
        self.surface.SetInputData(0, image)
        self.surface.SetInputDataObject(1, self.body)
        self.surface.Update()
        self.errors.check()
        return pipeline.force_row(self.surface.GetOutputDataObject(1))[0]


class FromTracks:
    """The chain of `rimflow process` on a track file of the reference flow."""

    def __init__(self, sphere, tracks, spacing=None):
        self.sphere = sphere
        arguments = [tracks, "--out", "unused", "--diameter", f"{sphere.diameter!r}m"]
        arguments += ["--density", repr(sphere.density), "--viscosity", repr(sphere.viscosity), "--body-density", "none"]
        self.chain = pipeline.Chain(options.parse(arguments + (["--spacing", f"{spacing!r}m"] if spacing else [])))

    def trajectory(self):
        """The smoothed path over all snapshots."""
        records, walls = [], []
        for k, time in enumerate(self.chain.times()):
            records.append({"snapshot": k, "time_s": time, **self.chain.locate(time)})
            wall = self.chain.wall().NewInstance()
            wall.ShallowCopy(self.chain.wall())
            walls.append(wall)
        return process.assembled(records, self.sphere.diameter, process.smooth(records, self.sphere.diameter, walls))

    def snapshots(self, every):
        """(index, row of the table) for every so many snapshots."""
        path, flows = self.trajectory(), pipeline.FlowChain(self.chain)
        for k in range(every // 2, len(path.time), every):
            time = float(path.time[k])
            flow = flows.compute(time, pipeline.body(path, k))
            if flow.failed:
                raise pipeline.PipelineError(f"snapshot {k}: {flow.failed}")
            row = {"time_s": time, **balance_of(self.sphere, flow.forces), "coverage": flow.forces["coverage"]}
            row["centre_error_um"] = 1e6 * np.linalg.norm(path.centre[k] - self.sphere.centre_at(time))
            row["spacing_m"] = flow.image.GetSpacing()[0]
            row.update(self.field_errors(flow.image, time))
            yield k, row

    def field_errors(self, image, time):
        distance = 1.5 * image.GetSpacing()[0]
        points = nodes_of(image)
        judged = outside(self.sphere, points, time, distance) & (array_of(image, "Mask") == 0)
        points = points[judged]
        acceleration, _ = self.sphere.acceleration_and_q(points, time)
        return {
            "pressure_error": pressure_error(self.sphere, image, time, distance),
            "acceleration_error": relative_error(array_of(image, "MaterialAcceleration")[judged], acceleration),
            "velocity_error": relative_error(array_of(image, "Velocity")[judged], self.sphere.velocity(points, time)),
        }
