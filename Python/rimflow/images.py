"""Pictures of a run (`--images`), drawn by ParaView from the files that the run wrote."""
import os

import matplotlib.pyplot as plt
import numpy as np

from rimflow.files import replacing
from rimflow.force_report import LETTERS
from rimflow.options import is_series
from rimflow.pipeline import FOUND

SIZE, TITLE = (1400, 1050), 60  # pixels; TITLE: height of the strip above the picture
TILE, TALL_TILE = (520, 520), (520, 780)


def draw(out, trajectory, tracks, up, forces=None):
    """Draws the snapshot in the middle of those where the sphere was found, and the pressure on the sphere at its instants, into
    `out`/report. Without a snapshot: nothing.

    trajectory: rimflow.process.Trajectory. tracks: the track files. up: direction that points up in the picture.
    forces: rimflow.forces.Forces or None.
    """
    from paraview import simple

    found = np.flatnonzero(trajectory.status == FOUND)
    if not len(found):
        return
    row = found[len(found) // 2]
    scene = Scene(simple, out, trajectory, row, up)
    scene.tracks(tracks)
    if os.path.exists(os.path.join(out, "fields.pvd")) and scene.speed > 0:
        scene.slice()
        scene.vortices()
    if forces and forces.surfaces:
        surface_pressure(simple, out, trajectory, forces, up)


def surface_pressure(simple, out, trajectory, forces, up):
    """surface.png: a column per instant; the pressure on the sphere with the vortices from the side, and from the front and the rear."""
    low, high = np.percentile(np.concatenate([pressure for _, pressure in forces.surfaces.values()]), [0.5, 99.5])
    limit = max(abs(low), abs(high), 1e-12)
    instants = [(letter, row) for letter, row in zip(LETTERS, forces.instants) if row in forces.surfaces]
    tiles = [Scene(simple, out, trajectory, row, up).pressure_tiles(limit) for _, row in instants]
    figure, axes = plt.subplots(3, len(tiles), figsize=(3.2 * len(tiles) + 1.2, 11.5), layout="constrained", squeeze=False,
                                gridspec_kw={"height_ratios": (TALL_TILE[1], TILE[1], TILE[1])})
    for column, (letter, row) in enumerate(instants):
        axes[0, column].set_title(f"{letter}: {trajectory.time[row]:.6g} s")
        for ax, tile in zip(axes[:, column], tiles[column]):
            ax.imshow(tile)
    for ax in axes.flat:
        ax.set(xticks=[], yticks=[])
        ax.spines[:].set_visible(False)
    vortices = " with vortices" if os.path.exists(os.path.join(out, "fields.pvd")) else ""
    for ax, label in zip(axes[:, 0], ("from the side" + vortices, "front (leading side)", "rear")):
        ax.set_ylabel(label)
    colours = plt.cm.ScalarMappable(plt.Normalize(-limit, limit), "coolwarm")
    figure.colorbar(colours, ax=axes, shrink=0.5, label="pressure on the sphere [Pa], zero: mean over the measured volume")
    with replacing(os.path.join(out, "report", "surface.png")) as temporary:
        figure.savefig(temporary, dpi=100)
    plt.close(figure)


def pixels(view):
    """What a view shows, as an array (height, width, 3) of bytes from the top down."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    captured = view.SMProxy.CaptureWindow(1)
    width, height, _ = captured.GetDimensions()
    array = vtk_to_numpy(captured.GetPointData().GetScalars()).reshape(height, width, -1)[::-1].copy()
    if captured.GetReferenceCount() > 1:  # ParaView 5.11 gives it away with a reference too many: 2.4 MB for each frame of a movie
        captured.UnRegister(None)
    return array


def q_level(speed, diameter):
    """The Q of the iso-surfaces: a quarter of (V/d)^2, the scale of the gradients that the sphere's motion makes."""
    return 0.25 * (speed / diameter)**2


def add_title(path, title):
    """Puts a strip with the title above a picture, pixel for pixel."""
    picture = plt.imread(path)
    height, width = picture.shape[:2]
    figure = plt.figure(figsize=(width / 100, (height + TITLE) / 100), dpi=100, facecolor="white")
    figure.figimage(picture, 0, 0)
    figure.text(0.5, 1 - 0.5 * TITLE / (height + TITLE), title, ha="center", va="center", fontsize=19, color="0.15")
    figure.savefig(path, dpi=100)
    plt.close(figure)


class Scene:
    """One snapshot: the camera looks across the motion, so that the sphere and its wake are seen from the side."""

    def __init__(self, simple, out, trajectory, row, up):
        self.simple, self.out, self.time = simple, out, trajectory.time[row]
        self.diameter, self.centre = trajectory.diameter, trajectory.centre[row]
        self.motion = trajectory.velocity[row]
        self.up = np.asarray(up, float) / np.linalg.norm(up)
        self.speed = float(np.linalg.norm(self.motion))
        side = np.eye(3)[np.argmin(np.abs(self.up))]
        self.across = np.cross(side, self.up)
        if self.across[np.argmax(np.abs(self.across))] < 0:
            self.across = -self.across
        self.sphere = simple.PVDReader(FileName=os.path.join(out, "sphere.pvd"))
        self.path = simple.XMLPolyDataReader(FileName=[os.path.join(out, "trajectory.vtp")])

    def view(self, size=SIZE):
        self.simple._DisableFirstRenderCameraReset()  # or the first picture is seen from elsewhere
        view = self.simple.CreateView("RenderView")
        view.ViewSize = size
        view.OrientationAxesVisibility = 1
        view.UseColorPaletteForBackground = 0
        view.Background = [1, 1, 1]
        view.ViewTime = self.time
        self.simple.SetActiveView(view)
        return view

    def add_sphere(self, view):
        ball = self.simple.Show(self.sphere, view)
        ball.ColorArrayName = ["POINTS", ""]
        ball.DiffuseColor, ball.Specular, ball.SpecularPower = [0.93, 0.93, 0.9], 0.5, 30
        tube = self.simple.Tube(Input=self.path, Radius=0.012 * self.diameter)
        tube.Scalars, tube.Vectors = ["POINTS", ""], ["POINTS", ""]
        line = self.simple.Show(tube, view)
        line.ColorArrayName = ["POINTS", ""]
        line.DiffuseColor = [0.1, 0.1, 0.1]

    def colour(self, view, source, array, low, high, title, component="Magnitude", preset="Viridis (matplotlib)"):
        shown = self.simple.Show(source, view)
        self.simple.ColorBy(shown, ("POINTS", array) if component is None else ("POINTS", array, component))
        table = self.simple.GetColorTransferFunction(array, shown, separate=True)
        shown.UseSeparateColorMap = 1
        self.simple.ColorBy(shown, ("POINTS", array) if component is None else ("POINTS", array, component), separate=True)
        table.ApplyPreset(preset, True)
        table.RescaleTransferFunction(low, high)
        shown.LookupTable = table
        if title is None:
            shown.SetScalarBarVisibility(view, False)
            return shown
        bar = self.simple.GetScalarBar(table, view)
        bar.Title, bar.ComponentTitle = title, ""
        bar.TitleColor = bar.LabelColor = [0.15, 0.15, 0.15]
        bar.TitleFontSize = bar.LabelFontSize = 20
        bar.Visibility = 1
        shown.SetScalarBarVisibility(view, True)
        return shown

    def save(self, view, name, title, distance, turn=0.0):
        """distance: height of what is seen, in diameters. turn: degrees around the upward direction."""
        a = np.radians(turn)
        right = np.cross(self.up, self.across)
        direction = np.cos(a) * self.across + np.sin(a) * right + 0.25 * np.sin(abs(a)) * self.up
        self.aim(view, self.centre - 0.12 * distance * self.diameter * self.up, direction, self.up, distance)
        path = os.path.join(self.out, "report", name)
        with replacing(path) as temporary:
            self.simple.SaveScreenshot(temporary, view, ImageResolution=SIZE)
            add_title(temporary, title)
        self.simple.Delete(view)

    def aim(self, view, focus, direction, up, distance):
        """The camera looks at focus from where direction points to; distance: height of what is seen, in diameters."""
        direction = direction / np.linalg.norm(direction)
        view.CameraParallelProjection = 1
        view.CameraFocalPoint = list(focus)
        view.CameraPosition = list(focus + 20 * self.diameter * direction)
        view.CameraViewUp = list(up)
        view.CameraParallelScale = 0.5 * distance * self.diameter

    def pressure_tiles(self, limit):
        """Pictures of the pressure on the sphere: from the side, with the vortices where there are fields, from its front and its rear."""
        view = self.view(TALL_TILE)
        view.OrientationAxesVisibility = 0
        ball = self.colour(view, self.sphere, "Pressure", -limit, limit, None, component=None, preset="Cool to Warm")
        ball.Ambient, ball.Diffuse, ball.Specular = 0.6, 0.4, 0.0  # mostly flat, so that the colour is that of the scale
        vortices = None
        if os.path.exists(os.path.join(self.out, "fields.pvd")):
            vortices = self.simple.Show(self.q_surface(self.fields()), view)
            self.simple.ColorBy(vortices, None)
            vortices.DiffuseColor, vortices.Opacity = [0.5, 0.55, 0.5], 0.25
        ahead = self.motion / self.speed
        self.aim(view, self.centre - 0.65 * self.diameter * self.up, self.across, self.up, 2.8)
        tiles = [self.shot(view, TALL_TILE)]
        if vortices:
            vortices.Visibility = 0
        for direction in (ahead, -ahead):
            self.aim(view, self.centre, direction, self.across, 1.25)
            tiles.append(self.shot(view, TILE))
        self.simple.Delete(view)
        return tiles

    def shot(self, view, size):
        """What the view shows, as an array."""
        view.ViewSize = size
        return pixels(view)

    def q_surface(self, flow):
        """The vortices."""
        return self.simple.Contour(Input=flow, ContourBy=["POINTS", "QCriterion"], Isosurfaces=[float(self.q_level)])

    @property
    def q_level(self):
        return q_level(self.speed, self.diameter)

    def tracks(self, names):
        simple = self.simple
        view = self.view()
        if is_series(names[0]):
            reader = simple.PVDReader(FileName=names[0])  # particles: a series has no pathlines
        else:
            reader = simple.STBTrackReader(FileNames=names, OutputMode="Pathlines", TrailLength=6)
        reader.UpdatePipeline(self.time)
        slab = simple.Clip(Input=reader, ClipType="Box")
        half = [3 * self.diameter] * 3
        axis = int(np.argmax(np.abs(self.across)))
        half[axis] = 0.25 * self.diameter
        slab.ClipType.Position = [float(c - h) for c, h in zip(self.centre, half)]
        slab.ClipType.Length = [2 * h for h in half]
        shown = self.colour(view, slab, "Velocity", 0, 0.6 * self.speed, "speed [m/s]")
        shown.LineWidth, shown.PointSize = 2.5, 4
        self.add_sphere(view)
        self.save(view, "tracks.png", "Particle tracks within a quarter diameter of the sphere's middle plane, and the sphere found among them", 4.2)

    def fields(self):
        reader = self.simple.PVDReader(FileName=os.path.join(self.out, "fields.pvd"))
        reader.UpdatePipeline(self.time)
        return reader

    def slice(self):
        simple = self.simple
        view = self.view()
        cut = simple.Slice(Input=self.fields())
        cut.SliceType.Origin, cut.SliceType.Normal = list(self.centre), list(self.across)
        self.colour(view, cut, "Velocity", 0, self.speed, "speed [m/s]")
        arrows = simple.Glyph(Input=cut, GlyphType="2D Glyph", OrientationArray=["POINTS", "Velocity"], ScaleArray=["POINTS", "Velocity"],
                              ScaleFactor=float(0.5 * self.diameter / self.speed), GlyphMode="Uniform Spatial Distribution (Bounds Based)",
                              MaximumNumberOfSamplePoints=700, Seed=1)
        shown = simple.Show(arrows, view)
        shown.ColorArrayName = ["POINTS", ""]
        shown.DiffuseColor = shown.AmbientColor = [1, 1, 1]
        self.add_sphere(view)
        self.save(view, "slice.png", "Velocity in the plane through the sphere's centre", 4.2)

    def vortices(self):
        simple, view = self.simple, self.view()
        along = simple.Calculator(Input=self.fields(), ResultArrayName="AlongMotion",
                                  Function="+".join(f"({c / self.speed:.9g})*Velocity_{a}" for c, a in zip(self.motion, "XYZ")))
        shown = self.colour(view, self.q_surface(along), "AlongMotion", -0.3 * self.speed, self.speed, "velocity along the motion [m/s]", component=None)
        shown.Opacity = 0.75
        self.add_sphere(view)
        self.save(view, "vortices.png", f"Vortices: iso-surface of Q = {self.q_level:.0f} 1/s2, coloured by the velocity along the motion", 3.4, turn=25)
