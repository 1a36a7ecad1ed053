# `./rimflow gui FILES`: opens the files with the track reader and shows them coloured by speed.
import os

from paraview import simple

simple._DisableFirstRenderCameraReset()
tracks = simple.STBTrackReader(registrationName="Tracks", FileNames=os.environ["RIMFLOW_FILES"].split("\n"))
simple.GetAnimationScene().UpdateAnimationUsingDataTimeSteps()
view = simple.GetActiveViewOrCreate("RenderView")
shown = simple.Show(tracks, view)
simple.ColorBy(shown, ("POINTS", "Velocity", "Magnitude"))
shown.SetScalarBarVisibility(view, True)
simple.ResetCamera(view)
simple.Render(view)
