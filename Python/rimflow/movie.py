"""The movie of a run (`--movie`): the sphere with the pressure on it, its wake, and the drag over time, a frame per snapshot.

Into report/movie/ come NNNNNN.png (frames, by the snapshot's number), movie.avi (Motion JPEG, for players and slides), preview.webp (small,
for index.html: browsers play no AVI) and movie.json (what the report says of it). One snapshot is in memory at a time.
"""
import contextlib
import os
import shutil
import sys

import matplotlib.pyplot as plt
import numpy as np
from matplotlib import font_manager
from PIL import Image, ImageDraw, ImageFont, features
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkDataObject, vtkImageData, vtkPolyData
from vtkmodules.vtkFiltersCore import vtkContourFilter
from vtkmodules.vtkIOXML import vtkXMLImageDataReader

from rimflow import files, force_report, forces, pipeline
from rimflow.images import Scene, pixels, q_level
from rimflow.pipeline import LOST, PREDICTED
from rimflow.progress import ProgressBar

PICTURE, PANEL = (900, 900), (540, 900)  # pixels: what ParaView draws, and the numbers to the right of it
SEEN = 3.4                               # height of the picture in diameters
PREVIEW_WIDTH, PREVIEW_FRAMES = 800, 100
DARK, LINE_HEIGHT = (40, 40, 40), 38


def draw(out, trajectory, loads, up):
    """Draws every snapshot in which the sphere is known; returns those left out, [(snapshot, reason)]. Without any: no movie.

    out: the run's folder with sphere/, and the wake from wake/ (see `wake`) or else from fields/, as far as they are there.
    trajectory: rimflow.process.Trajectory. loads: rimflow.forces.Forces or None. up: direction that points up in the picture.
    """
    folder = os.path.join(out, "report", "movie")
    shutil.rmtree(folder, ignore_errors=True)
    os.makedirs(folder)
    left_out = [(int(k), "the sphere is lost") for k in trajectory.snapshot[trajectory.status == LOST]]
    rows = np.flatnonzero(trajectory.status != LOST)
    if not len(rows):
        return left_out
    limit = pressure_limit(out, trajectory, rows)
    panel, stage = Panel(trajectory, loads, limit), Stage(out, trajectory, rows, up, limit)
    bar, frames, waves = ProgressBar("movie", len(rows)), [], 0
    for done, row in enumerate(rows):
        bar.show(done)
        snapshot = int(trajectory.snapshot[row])
        try:
            picture, with_wake = stage.shot(row, snapshot)
        except pipeline.PipelineError as error:
            left_out.append((snapshot, str(error)))
            continue
        waves += with_wake
        frames.append(os.path.join(folder, f"{snapshot:06d}.png"))
        with files.replacing(frames[-1]) as temporary:
            panel.beside(picture, row).save(temporary)
    bar.show(len(rows))
    rate = int(np.clip(len(frames) / 8, 4, 25))  # at least 8 s, if they last
    video = write_video(os.path.join(folder, "movie"), frames, rate) if frames else None
    preview = write_preview(os.path.join(folder, "preview"), frames, rate) if frames else None
    files.write_json(os.path.join(folder, "movie.json"), {
        "frames": len(frames), "frames_with_wake": waves, "rate_per_s": rate, "video": video, "preview": preview,
        "left_out": [list(item) for item in sorted(left_out)]})
    return sorted(left_out)


def wake_level(trajectory):
    """The Q of the surface that shows the wake, the same in all frames."""
    speed = np.linalg.norm(trajectory.velocity[trajectory.status != LOST], axis=1)
    return float(q_level(speed.mean() if len(speed) else 0.0, trajectory.diameter))


def wake(image, level):
    """The iso-surface QCriterion = level of a flow, without further arrays."""
    contour, surface = vtkContourFilter(), vtkPolyData()
    contour.SetInputData(image)
    contour.SetInputArrayToProcess(0, 0, 0, vtkDataObject.FIELD_ASSOCIATION_POINTS, "QCriterion")
    contour.SetValue(0, level)
    contour.ComputeScalarsOff()
    contour.Update()
    surface.CopyStructure(contour.GetOutput())
    surface.GetPointData().SetNormals(contour.GetOutput().GetPointData().GetNormals())
    return surface


def sphere_path(out, snapshot):
    return os.path.join(out, "sphere", f"{snapshot:06d}.vtp")


def checked(path, read):
    """What read(path) gives, or PipelineError where there is nothing to see."""
    name = os.path.join(os.path.basename(os.path.dirname(path)), os.path.basename(path))
    if not os.path.exists(path):
        raise pipeline.PipelineError(f"{name} is missing")
    data = read(path)
    if not data.GetNumberOfPoints():
        raise pipeline.PipelineError(f"{name} is empty or damaged")
    return data


def read_image(path):
    reader, errors = vtkXMLImageDataReader(), pipeline.Errors()
    errors.watch(reader)
    reader.SetFileName(path)
    reader.Update()
    errors.check()
    return reader.GetOutput()


def pressure_limit(out, trajectory, rows, most=50):
    """The end of the colour scale, the same for all frames, Pa: what 99 % of the pressures in up to `most` snapshots stay within.
    None where no pressure is known."""
    found = []
    for row in rows[np.unique(np.linspace(0, len(rows) - 1, min(most, len(rows))).astype(int))]:
        path = sphere_path(out, trajectory.snapshot[row])
        pressure = os.path.exists(path) and pipeline.read_polydata(path).GetPointData().GetArray("Pressure")
        if pressure:
            found.append(vtk_to_numpy(pressure))
    return max(float(np.percentile(np.abs(np.concatenate(found)), 99)), 1e-12) if found else None


class Stage:
    """What ParaView draws: a camera that follows the sphere and always looks from the same side, with the wake behind the sphere."""

    def __init__(self, out, trajectory, rows, up, limit):
        from paraview import simple

        self.simple, self.out, self.trajectory, self.limit = simple, out, trajectory, limit
        self.level = wake_level(trajectory)
        self.scene = Scene(simple, out, trajectory, rows[len(rows) // 2], up)
        mean = trajectory.velocity[rows].mean(axis=0)
        ahead = mean / max(np.linalg.norm(mean), 1e-300)
        across = np.cross(ahead, self.scene.up)
        # a sphere that moves sideways is seen from the side, too; one that rises or sinks along the axis that the pictures use
        self.across = across / np.linalg.norm(across) if np.linalg.norm(across) > 0.5 else self.scene.across
        self.behind = 0.65 * trajectory.diameter * ahead
        self.view = self.scene.view(PICTURE)
        self.view.OrientationAxesVisibility = 0
        self.ball, self.ball_shown = self.producer(), None
        self.wake, self.wake_shown = self.producer(), None
        tube = simple.Tube(Input=self.scene.path, Radius=0.008 * trajectory.diameter)
        tube.Scalars, tube.Vectors = ["POINTS", ""], ["POINTS", ""]
        line = simple.Show(tube, self.view)
        line.ColorArrayName, line.DiffuseColor = ["POINTS", ""], [0.1, 0.1, 0.1]

    def producer(self):
        source = self.simple.TrivialProducer()
        source.GetClientSideObject().SetOutput(vtkPolyData())
        return source

    def give(self, source, data):
        source.GetClientSideObject().SetOutput(data)
        source.MarkModified(source)
        source.UpdatePipeline()

    def wake_of(self, snapshot):
        """The wake's surface, empty where its file lacks or cannot be read."""
        name = f"{snapshot:06d}"
        try:
            path = os.path.join(self.out, "wake", f"{name}.vtp")
            if os.path.exists(path):
                return checked(path, pipeline.read_polydata)
            return wake(checked(os.path.join(self.out, "fields", f"{name}.vti"), read_image), self.level)
        except pipeline.PipelineError:
            return vtkPolyData()

    def shot(self, row, snapshot):
        """The picture of one snapshot, and whether there is a wake in it."""
        surface = checked(sphere_path(self.out, snapshot), pipeline.read_polydata)
        behind = self.wake_of(snapshot)
        self.give(self.ball, surface)
        self.give(self.wake, behind)
        if self.ball_shown is None:
            self.show()
        pressure = self.limit is not None and surface.GetPointData().HasArray("Pressure")
        self.ball_shown.ColorArrayName = ["POINTS", "Pressure" if pressure else ""]
        self.wake_shown.Visibility = int(behind.GetNumberOfPoints() > 0)
        centre = np.asarray(self.trajectory.centre[row], float)
        self.scene.aim(self.view, centre - self.behind, self.across, self.scene.up, SEEN)
        return Image.fromarray(pixels(self.view)), behind.GetNumberOfPoints() > 0

    def show(self):
        self.ball_shown = self.simple.Show(self.ball, self.view)
        self.ball_shown.Ambient, self.ball_shown.Diffuse, self.ball_shown.Specular = 0.6, 0.4, 0.0  # flat: the colour is that of the scale
        self.ball_shown.DiffuseColor = self.ball_shown.AmbientColor = [0.85, 0.85, 0.82]
        if self.limit is not None:
            table = self.simple.GetColorTransferFunction("Pressure")
            table.ApplyPreset("Cool to Warm", True)
            table.RescaleTransferFunction(-self.limit, self.limit)
            self.ball_shown.LookupTable = table
        self.wake_shown = self.simple.Show(self.wake, self.view)
        self.wake_shown.ColorArrayName = ["POINTS", ""]
        self.wake_shown.DiffuseColor, self.wake_shown.AmbientColor, self.wake_shown.Opacity = [0.45, 0.55, 0.5], [0.45, 0.55, 0.5], 0.35


class Panel:
    """The right part of a frame: numbers of the snapshot, the drag (without forces: the speed) over time, and the colour scale. All that
    is the same in every frame is drawn once."""

    def __init__(self, trajectory, loads, limit):
        self.trajectory = trajectory
        step = np.diff(trajectory.time).min() if len(trajectory.time) > 1 else 1.0
        self.decimals = int(np.clip(np.ceil(1 - np.log10(step)), 0, 9))
        self.estimates = [e for e in forces.estimates(loads)[:2] if np.isfinite(e.force).any()] if loads else []
        self.coefficients = [forces.coefficients(loads, e) for e in self.estimates]
        figure = plt.figure(figsize=(PANEL[0] / 100, PANEL[1] / 100), dpi=100, facecolor="white")
        ax = figure.add_axes((0.17, 0.26, 0.78, 0.32))
        if self.estimates:
            for e, (cd, _, sigma), colour in zip(self.estimates, self.coefficients, (force_report.SURFACE, force_report.VOLUME)):
                force_report.series(ax, trajectory.time, cd, colour, e.name, sigma)
            ax.legend(loc="lower center", bbox_to_anchor=(0.46, 1.0), ncols=1, fontsize=11, frameon=False)
            ax.set_ylabel("drag coefficient Cd", fontsize=12)
        else:
            ax.plot(trajectory.time, np.linalg.norm(trajectory.velocity, axis=1), color=force_report.SPEED)
            ax.set_ylabel("speed of the sphere [m/s]", fontsize=12)
        ax.set_xlabel("time [s]", fontsize=12)
        ax.ticklabel_format(axis="x", useOffset=False)
        ax.xaxis.set_major_locator(plt.MaxNLocator(4))
        ax.grid(alpha=0.3)
        if limit is not None:
            colours = plt.cm.ScalarMappable(plt.Normalize(-limit, limit), "coolwarm")
            figure.colorbar(colours, cax=figure.add_axes((0.17, 0.115, 0.78, 0.025)), orientation="horizontal").set_label(
                "pressure on the sphere [Pa]\nzero: mean over the measured volume", fontsize=12)
        figure.canvas.draw()
        self.background = Image.fromarray(np.asarray(figure.canvas.buffer_rgba())[..., :3].copy())
        self.time_axis = ax.transData.transform([(t, 0) for t in trajectory.time])[:, 0]
        box = ax.get_window_extent()
        self.cursor_span = (PANEL[1] - box.y1, PANEL[1] - box.y0)
        plt.close(figure)
        face = font_manager.findfont("DejaVu Sans")
        self.font, self.small = (ImageFont.truetype(face, size) for size in (27, 21))

    def lines(self, row):
        """What the snapshot says in numbers."""
        t = self.trajectory
        yield f"t = {t.time[row]:.{self.decimals}f} s", self.font
        yield f"snapshot {int(t.snapshot[row])}" + (", predicted from its neighbours" if t.status[row] == PREDICTED else ""), self.small
        speed = np.linalg.norm(t.velocity[row])
        if np.isfinite(speed):
            yield f"V = {speed:.4g} m/s", self.font
        for e, (cd, _, sigma) in zip(self.estimates, self.coefficients):
            number = "not known" if not np.isfinite(cd[row]) else f"{cd[row]:.3f}" + (f" ± {sigma[row]:.3f}" if np.isfinite(sigma[row]) else "")
            yield f"Cd = {number}", self.font
            yield f"({e.name})", self.small

    def beside(self, picture, row):
        """The frame: the picture with this panel to its right."""
        panel = self.background.copy()
        pen = ImageDraw.Draw(panel)
        y = 40
        for text, font in self.lines(row):
            pen.text((40, y), text, fill=DARK, font=font)
            y += LINE_HEIGHT
        x = self.time_axis[row]
        pen.line([(x, self.cursor_span[0]), (x, self.cursor_span[1])], fill=(20, 20, 20), width=2)
        frame = Image.new("RGB", (PICTURE[0] + PANEL[0], PICTURE[1]), "white")
        frame.paste(picture, (0, 0))
        frame.paste(panel, (PICTURE[0], 0))
        return frame


def write_video(root, frames, rate):
    """The frames as root.avi by ParaView's FFmpeg, or root.ogv where it was built without; the file's name, or None without either."""
    for module, name, extension in (("vtkIOFFMPEG", "vtkFFMPEGWriter", ".avi"), ("vtkIOOggTheora", "vtkOggTheoraWriter", ".ogv")):
        try:
            writer = getattr(__import__(f"vtkmodules.{module}", fromlist=[name]), name)()
        except ImportError:
            continue
        errors = pipeline.Errors()
        errors.watch(writer)
        path = root + extension
        with files.replacing(path) as temporary, silence():
            writer.SetFileName(temporary)
            writer.SetRate(rate)
            writer.SetQuality(2)
            for k, frame in enumerate(frames):
                writer.SetInputData(image_data(frame))
                if k == 0:
                    writer.Start()
                writer.Write()
            writer.End()
            if errors.messages or not os.path.getsize(temporary):
                raise OSError(None, "could not be written, is the disk full? " + "; ".join(errors.messages), path)
        return os.path.basename(path)
    return None


@contextlib.contextmanager
def silence():
    """FFmpeg warns on the standard error of every other frame that VTK uses an old name for a colour format."""
    sys.stderr.flush()
    kept = os.dup(2)
    with open(os.devnull, "wb") as nothing:
        os.dup2(nothing.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def image_data(path):
    """A PNG as VTK's image, which counts rows from below."""
    with Image.open(path) as picture:
        pixels = np.ascontiguousarray(np.asarray(picture.convert("RGB"))[::-1])
    image = vtkImageData()
    image.SetDimensions(pixels.shape[1], pixels.shape[0], 1)
    array = numpy_to_vtk(pixels.reshape(-1, 3), deep=True)
    array.SetName("colours")
    image.GetPointData().SetScalars(array)
    return image


def write_preview(root, frames, rate):
    """Up to PREVIEW_FRAMES frames, evenly spread and smaller, as an animation that browsers play; the file's name."""
    chosen = [frames[i] for i in np.unique(np.linspace(0, len(frames) - 1, min(PREVIEW_FRAMES, len(frames))).astype(int))]
    pictures = []
    for name in chosen:
        with Image.open(name) as picture:
            pictures.append(picture.resize((PREVIEW_WIDTH, PREVIEW_WIDTH * picture.height // picture.width), Image.LANCZOS))
    path = root + (".webp" if features.check("webp_anim") else ".gif")
    settings = {"quality": 75, "method": 4} if path.endswith(".webp") else {}
    with files.replacing(path) as temporary:
        pictures[0].save(temporary, save_all=True, append_images=pictures[1:], loop=0,
                         duration=int(1000 / rate * len(frames) / len(chosen)), **settings)
    return os.path.basename(path)
