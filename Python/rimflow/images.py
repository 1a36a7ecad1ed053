"""Pictures of a run (`--images`), drawn by ParaView from the files that the run wrote."""
import os

import numpy as np

from rimflow.files import replacing

SIZE = (1400, 1050)


def draw(out, trajectory, tracks, up):
    """Draws the snapshot in the middle of those where the sphere was found, into `out`/report. Without one: nothing.

    trajectory: rimflow.process.Trajectory. tracks: the track files. up: direction that points up in the picture.
    """
    from paraview import simple

    found = np.flatnonzero(trajectory.status == 0)
    if not len(found):
        return
    row = found[len(found) // 2]
    scene = Scene(simple, out, trajectory, row, up)
    scene.tracks(tracks)
    if os.path.exists(os.path.join(out, "fields.pvd")):
        scene.slice()
        scene.vortices()


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

    def view(self, title):
        simple = self.simple
        view = simple.CreateView("RenderView")
        view.ViewSize = SIZE
        view.OrientationAxesVisibility = 1
        view.UseColorPaletteForBackground = 0
        view.Background = [1, 1, 1]
        view.ViewTime = self.time
        simple.SetActiveView(view)
        text = simple.Text(Text=title)
        label = simple.Show(text, view)
        label.Color, label.FontSize, label.WindowLocation = [0.15, 0.15, 0.15], 24, "Upper Center"
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
        bar = self.simple.GetScalarBar(table, view)
        bar.Title, bar.ComponentTitle = title, ""
        bar.TitleColor = bar.LabelColor = [0.15, 0.15, 0.15]
        bar.TitleFontSize = bar.LabelFontSize = 20
        bar.Visibility = 1
        shown.SetScalarBarVisibility(view, True)
        return shown

    def save(self, view, name, distance, turn=0.0):
        """distance: height of what is seen, in diameters. turn: degrees around the upward direction."""
        a = np.radians(turn)
        right = np.cross(self.up, self.across)
        direction = np.cos(a) * self.across + np.sin(a) * right + 0.25 * np.sin(abs(a)) * self.up
        direction /= np.linalg.norm(direction)
        focus = self.centre - 0.12 * distance * self.diameter * self.up
        view.CameraParallelProjection = 1
        view.CameraFocalPoint = list(focus)
        view.CameraPosition = list(focus + 20 * self.diameter * direction)
        view.CameraViewUp = list(self.up)
        view.CameraParallelScale = 0.5 * distance * self.diameter
        self.simple.Render(view)
        path = os.path.join(self.out, "report", name)
        with replacing(path) as temporary:
            self.simple.SaveScreenshot(temporary, view, ImageResolution=SIZE)
        self.simple.Delete(view)

    def tracks(self, names):
        simple = self.simple
        view = self.view("Particle tracks within a quarter diameter of the sphere's middle plane, and the sphere found among them")
        reader = simple.STBTrackReader(FileNames=names, OutputMode="Pathlines", TrailLength=6)
        reader.UpdatePipeline(self.time)
        slab = simple.Clip(Input=reader, ClipType="Box")
        half = [3 * self.diameter] * 3
        axis = int(np.argmax(np.abs(self.across)))
        half[axis] = 0.25 * self.diameter
        slab.ClipType.Position = [float(c - h) for c, h in zip(self.centre, half)]
        slab.ClipType.Length = [2 * h for h in half]
        self.colour(view, slab, "Velocity", 0, 0.6 * self.speed, "speed [m/s]").LineWidth = 2.5
        self.add_sphere(view)
        self.save(view, "tracks.png", 4.2)

    def fields(self):
        reader = self.simple.PVDReader(FileName=os.path.join(self.out, "fields.pvd"))
        reader.UpdatePipeline(self.time)
        return reader

    def slice(self):
        simple = self.simple
        view = self.view("Velocity in the plane through the sphere's centre")
        cut = simple.Slice(Input=self.fields())
        cut.SliceType.Origin, cut.SliceType.Normal = list(self.centre), list(self.across)
        self.colour(view, cut, "Velocity", 0, self.speed, "speed [m/s]")
        arrows = simple.Glyph(Input=cut, GlyphType="2D Glyph", OrientationArray=["POINTS", "Velocity"], ScaleArray=["POINTS", "Velocity"],
                              ScaleFactor=float(0.5 * self.diameter / self.speed), GlyphMode="Every Nth Point", Stride=3)
        shown = simple.Show(arrows, view)
        shown.ColorArrayName = ["POINTS", ""]
        shown.DiffuseColor = shown.AmbientColor = [1, 1, 1]
        self.add_sphere(view)
        self.save(view, "slice.png", 4.2)

    def vortices(self):
        """An iso-surface of Q at a quarter of (V/d)^2, the scale of the gradients that the sphere's motion makes."""
        simple = self.simple
        flow = self.fields()
        level = 0.25 * (self.speed / self.diameter) ** 2
        view = self.view(f"Vortices: iso-surface of Q = {level:.0f} 1/s2, coloured by the velocity along the motion")
        along = simple.Calculator(Input=flow, ResultArrayName="AlongMotion",
                                  Function="+".join(f"({c / self.speed:.9g})*Velocity_{a}" for c, a in zip(self.motion, "XYZ")))
        surface = simple.Contour(Input=along, ContourBy=["POINTS", "QCriterion"], Isosurfaces=[float(level)])
        shown = self.colour(view, surface, "AlongMotion", -0.3 * self.speed, self.speed, "velocity along the motion [m/s]", component=None)
        shown.Opacity = 0.75
        self.add_sphere(view)
        self.save(view, "vortices.png", 4.2, turn=25)
