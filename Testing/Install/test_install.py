"""Breaks when the installed files cannot be used without the source and build folders: by a C++ program, by Python, in ParaView."""
import glob
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

SOURCE, BUILD = os.environ["RIMFLOW_SOURCE"], os.environ["RIMFLOW_BUILD"]
PARAVIEW = os.environ["RIMFLOW_PARAVIEW"] == "ON"
CMAKE = os.environ["CMAKE"]
DEMO = os.path.join(SOURCE, "Examples", "demo", "sphere.dat.gz")


def run(*command, folder, **environment):
    """What the command prints; RuntimeError with all of it where it fails. Nothing of RIMFlow is in its environment but `environment`."""
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PV_PLUGIN_PATH", "LD_LIBRARY_PATH") and not k.startswith("RIMFLOW_")}
    done = subprocess.run(command, cwd=folder, env={**clean, **environment}, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    if done.returncode or "ERR|" in done.stdout:
        raise RuntimeError(f"{' '.join(command)} ended with {done.returncode}:\n{done.stdout}")
    return done.stdout


class TestInstall(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="rimflow install ")  # a space, as people have them
        cls.addClassCleanup(folder.cleanup)
        cls.folder, cls.prefix = folder.name, os.path.join(folder.name, "prefix")
        run(CMAKE, "--install", BUILD, "--prefix", cls.prefix, folder=cls.folder)
        cls.python, = glob.glob(os.path.join(cls.prefix, "lib", "python3*", "site-packages"))

    def files(self):
        return [os.path.join(folder, name) for folder, _, names in os.walk(self.prefix) for name in names]

    def test_nothing_refers_to_the_source_or_the_build(self):
        for name in self.files():
            with open(name, "rb") as file:
                content = file.read()
            if content.startswith(b"\x7fELF"):  # the names of sources in messages are fine, the places of libraries are not
                paths = run("readelf", "-d", name, folder=self.folder)
                content = " ".join(re.findall(r"(?:RPATH|RUNPATH|NEEDED).*", paths)).encode()
            elif name.endswith(".a"):
                continue
            for place in (SOURCE, BUILD):
                self.assertNotIn(place.encode(), content, name)

    def test_headers_need_nothing_but_vtk(self):
        headers = [os.path.basename(name) for name in self.files() if name.endswith(".h")]
        self.assertGreaterEqual(set(headers), {"vtkSTBTrackReader.h", "vtkSyntheticTracks.h", "vtkInvisibleSphereLocator.h", "vtkTrajectorySmoother.h",
                                               "vtkVICSharpResample.h", "vtkQCriterion.h", "vtkOmni3DPressure.h", "vtkSurfaceForce.h"})
        for name in self.files():
            if name.endswith(".h"):
                with open(name) as file:
                    self.assertNotRegex(file.read(), r"#include *[<\"]Eigen", name)

    def configured_example(self, *options):
        shutil.copytree(os.path.join(SOURCE, "Examples", "cxx"), os.path.join(self.folder, "example"), dirs_exist_ok=True)
        return run(CMAKE, "-S", "example", "-B", "example-build", "-DCMAKE_BUILD_TYPE=Release", "-DCMAKE_PREFIX_PATH=" + self.prefix, *options,
                   folder=self.folder)

    def test_cxx_example(self):
        self.configured_example()
        run(CMAKE, "--build", "example-build", folder=self.folder)
        program = os.path.join(self.folder, "example-build", "forces")
        libraries = re.findall(r"libvtkRIMFlow\w+\.so => (.*) \(", run("ldd", program, folder=self.folder))
        self.assertEqual({os.path.dirname(os.path.realpath(name)) for name in libraries}, {os.path.realpath(os.path.join(self.prefix, "lib"))})

        printed = run(program, DEMO, "0.00953", "1820", "2.3825e-5", "surface.vtp", "8", folder=self.folder)
        print(printed)
        rows = [line.split() for line in printed.splitlines()[1:]]
        self.assertEqual(len(rows), 2)
        for time, drag, cd, *note in rows:  # Re = 100: 1.09
            self.assertAlmostEqual(float(cd), 1.09, delta=0.1)
            self.assertGreater(float(drag), 0)
        with open(os.path.join(self.folder, "surface.vtp"), "rb") as file:
            head = file.read().split(b"<AppendedData")[0]
        for array in (b"Pressure", b"Traction", b"Seen"):
            self.assertIn(b'Name="' + array + b'"', head)

        with self.assertRaisesRegex(RuntimeError, "(?s)ended with 1:.*nowhere.dat"):
            run(program, "nowhere.dat", "0.00953", "1820", "2.3825e-5", "none.vtp", folder=self.folder)
        self.assertFalse(os.path.exists(os.path.join(self.folder, "none.vtp")))
        with self.assertRaisesRegex(RuntimeError, "(?s)ended with 2:.*usage"):
            run(program, DEMO, folder=self.folder)

    def test_python_modules(self):
        code = ("import rimflow, os; from rimflow.vtkRIMFlowReaders import vtkSyntheticTracks; from rimflow.vtkRIMFlowFilters import vtkVICSharpResample\n"
                "t = vtkSyntheticTracks(); t.Update(); assert t.GetOutput().GetNumberOfPoints() > 100\nprint(os.path.dirname(rimflow.__file__))")
        printed = run(sys.executable, "-c", code, folder=self.folder, PYTHONPATH=self.python)
        self.assertEqual(printed.split("\n")[-2], os.path.join(self.python, "rimflow"))

    @unittest.skipUnless(PARAVIEW, "built without ParaView")
    def test_plugin(self):
        with open(os.path.join(self.folder, "plugin.py"), "w") as file:
            file.write("from paraview import simple\n"
                       "tracks = simple.SyntheticTracks()\n"
                       "image = simple.VICSharpResample(Particles=tracks, Spacing=0.003)\n"
                       "image.UpdatePipeline(tracks.TimestepValues[2])\n"
                       "print('speed', image.PointData['Velocity'].GetRange(-1)[1])\n"
                       "print([line.split()[-1] for line in open('/proc/self/maps') if 'RIMFlow' in line])\n")
        printed = run("pvpython", "plugin.py", folder=self.folder, PYTHONPATH=self.python, PV_PLUGIN_PATH=os.path.join(self.prefix, "lib", "rimflow", "plugins"))
        self.assertGreater(float(re.search(r"speed (\S+)", printed)[1]), 0.1)
        self.assertNotIn(BUILD, printed)

    @unittest.skipUnless(PARAVIEW, "built without ParaView")
    def test_command_line(self):
        run("pvbatch", os.path.join(self.python, "rimflow", "convert.py"), DEMO, os.path.join(self.folder, "tracks.pvd"), folder=self.folder,
            PYTHONPATH=self.python, PV_PLUGIN_PATH=os.path.join(self.prefix, "lib", "rimflow", "plugins"))
        self.assertGreater(os.path.getsize(os.path.join(self.folder, "tracks.pvd")), 500)


if __name__ == "__main__":
    unittest.main(verbosity=2)
