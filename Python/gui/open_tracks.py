# `./rimflow gui FILES`: opens the files with the track reader, or a series that `rimflow convert` made of them, and shows them coloured by speed.
import os

from paraview import simple

simple._DisableFirstRenderCameraReset()
names = os.environ["RIMFLOW_FILES"].split("\n")
if names[0].lower().endswith(".pvd"):
    tracks = simple.PVDReader(registrationName="Tracks", FileName=names[0])
else:
    tracks = simple.STBTrackReader(registrationName="Tracks", FileNames=names)
simple.GetAnimationScene().UpdateAnimationUsingDataTimeSteps()
view = simple.GetActiveViewOrCreate("RenderView")
shown = simple.Show(tracks, view)
simple.ColorBy(shown, ("POINTS", "Velocity", "Magnitude"))
shown.SetScalarBarVisibility(view, True)
simple.ResetCamera(view)
simple.Render(view)
