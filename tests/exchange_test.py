"""What `voxspring run --out` writes, read back by VTK and numpy.

VOXSPRING names the executable; the current directory is the source tree. Needs the packages of tests/requirements.txt in
build/test-venv, which `./run test` installs; where they are missing all of this is skipped: exit code 77.
"""

import csv
import json
import os
import pathlib
import re
import sys
import unittest
import xml.etree.ElementTree

PYTHON = pathlib.Path("build/test-venv/bin/python").absolute()
SKIPPED = 77
if pathlib.Path(sys.prefix) != PYTHON.parent.parent:
    if not PYTHON.exists():
        print(f"skipped: there is no {PYTHON}: run ./run test")
        sys.exit(SKIPPED)
    os.execv(PYTHON, [PYTHON, "-W", "error", *sys.argv])

import numpy  # noqa: E402
from program import InTemporaryFolder, json_of, nrrd, succeeds, voxspring  # noqa: E402
from vtkmodules.util.numpy_support import vtk_to_numpy  # noqa: E402
from vtkmodules.vtkIOXML import vtkXMLImageDataReader, vtkXMLUnstructuredGridReader  # noqa: E402

ENDINGS = (".csv", ".npz", ".vti", ".vtu")
VTK_LINE = 3
# Springs are cut after steps 50, 250, ... and sutured again after steps 150, 350, ...
EDITED = "scalpel_10"


def info(scene):
    return json_of("info", scene, "--json")


def read_csv(path):
    with open(path) as file:
        rows = list(csv.DictReader(file))
    return {"".join(key): numpy.array([[row[k] for k in names] for row in rows], dtype)
            for key, names, dtype in (("voxel", ("voxel_x", "voxel_y", "voxel_z"), int),
                                      ("position", ("x", "y", "z"), float),
                                      ("displacement", [f"displacement_{a}" for a in "xyz"], float),
                                      ("velocity", [f"velocity_{a}" for a in "xyz"], float))}


def arrays(attributes):
    return {attributes.GetArrayName(a): vtk_to_numpy(attributes.GetArray(a)) for a in range(attributes.GetNumberOfArrays())}


def read_vtk(path):
    """The dataset and its point, cell and field data; VTK must read it without any message."""
    reader = {".vtu": vtkXMLUnstructuredGridReader, ".vti": vtkXMLImageDataReader}[path.suffix]()
    complaints = []
    for event in ("ErrorEvent", "WarningEvent"):
        reader.AddObserver(event, lambda *_: complaints.append(path))
    reader.SetFileName(str(path))
    reader.Update()
    assert not complaints, complaints
    data = reader.GetOutput()
    return data, arrays(data.GetPointData()), arrays(data.GetCellData()), arrays(data.GetFieldData())


def lines(grid):
    """The particles at the ends of each line, the smaller first."""
    assert {grid.GetCellType(c) for c in range(grid.GetNumberOfCells())} <= {VTK_LINE}
    ends = vtk_to_numpy(grid.GetCells().GetConnectivityArray()).reshape(-1, 2)
    return numpy.sort(ends, axis=1)


class Exported(InTemporaryFolder):
    def run_scene(self, scene, *endings, steps=40, every=None, backend="cpu_parallel"):
        # The grid needs another name, since two series of one name would share a .pvd.
        paths = [self.folder / ("grid.vti" if ending == ".vti" else f"body{ending}") for ending in endings]
        out = [word for path in paths for word in ("--out", path)]
        succeeds("run", scene, "--backend", backend, "--steps", steps, *out,
                 *([] if every is None else ["--every", every]))
        return paths

    def assert_same(self, a, b):
        """Equal to the bit, and not all zero, since zeros would be equal in any order."""
        self.assertEqual(a.shape, b.shape)
        self.assertTrue((a == b).all())
        self.assertTrue(a.any())


class Formats(Exported):
    def test_particles_and_springs_of_every_format_are_the_same(self):
        self.addTypeEqualityFunc(numpy.ndarray, self.assert_same)
        for scene in ("heart", "beam"):
            with self.subTest(scene):
                text, numpys, grid, body = self.run_scene(scene, *ENDINGS)
                described = info(scene)
                expected = read_csv(text)
                loaded = numpy.load(numpys)
                unstructured, points, cells, fields = read_vtk(body)
                self.assert_same(vtk_to_numpy(unstructured.GetPoints().GetData()), expected["position"])
                for key in ("position", "displacement", "velocity", "voxel"):
                    self.assert_same(loaded[key], expected[key])
                for key in ("displacement", "velocity", "voxel"):
                    self.assert_same(points[key], expected[key])
                self.assertEqual(points["pinned"].sum(), described["pinned_particles"])

                springs = lines(unstructured)
                self.assertEqual(len(springs), described["springs"]["total"])
                self.assertEqual(len(numpy.unique(springs, axis=0)), len(springs), "a spring is there once")
                self.assert_same(loaded["springs"].astype(int), springs)
                offset = loaded["position"][springs[:, 0]] - loaded["position"][springs[:, 1]]
                # Computed from positions, whose difference loses up to 1e-16 of a coordinate of up to 64.
                tension = cells["stiffness"] * (numpy.linalg.norm(offset, axis=1) - cells["rest_length"])
                numpy.testing.assert_allclose(cells["tension"], tension, rtol=0, atol=1e-13 * cells["stiffness"].max())
                self.assertGreater(abs(tension).max(), 1e-9)
                for key in ("rest_length", "stiffness", "tension"):
                    self.assert_same(loaded[key], cells[key])
                for key in ("mass", "pinned", "material"):
                    self.assertTrue((loaded[key] == points[key]).all(), key)
                self.assertEqual(loaded["dims"].tolist(), described["dims"])
                self.assertEqual(loaded["spacing"].tolist(), described["spacing"])
                self.assertEqual(loaded["step"], 40)
                self.assertEqual(loaded["time_step"], described["time_step"])
                self.assertEqual(fields["TimeValue"].tolist(), [loaded["time"]])

                image, voxels, _, fields = read_vtk(grid)
                self.assertEqual(list(image.GetDimensions()), described["dims"])
                self.assertEqual(list(image.GetSpacing()), described["spacing"])
                self.assertEqual(fields["step"].tolist(), [40])
                at = numpy.ravel_multi_index(expected["voxel"].T, described["dims"], order="F")
                active = numpy.zeros(described["voxels"], bool)
                active[at] = True
                self.assertTrue((voxels["active"] == active).all())
                for key in ("displacement", "velocity"):
                    self.assert_same(voxels[key][at], expected[key])
                for key, values in voxels.items():
                    self.assertFalse(values[~active].any(), f"{key} of inactive voxels")
                self.assertTrue((voxels["label"][at] == points["material"] + 1).all())
                self.assertTrue((voxels["mass"][at] == points["mass"]).all())
                self.assertTrue((voxels["springs"][at] == numpy.bincount(springs.ravel(), minlength=len(at))).all())

    def test_several_labels_are_several_materials(self):
        scene = self.write("labels.json", {"dataset": {"type": "volume", "file": "labels.nrrd"}, "spacing": [1, 2, 0.5],
                                           "mass": {"1": 1, "7": 3}, "stiffness": {"1": 1, "7": 5}, "gravity": [0, 0, -1e-3]})
        self.write("labels.nrrd", nrrd("3 2 1", [1, 7, 0, 7, 1, 1]))
        numpys, grid, body = self.run_scene(scene, ".npz", ".vti", ".vtu", steps=3)
        loaded = numpy.load(numpys)
        self.assertEqual(loaded["mass"].tolist(), [1, 3, 3, 1, 1])
        self.assertEqual(loaded["spacing"].tolist(), [1, 2, 0.5])
        # Springs between labels 1 and 1, 7 and 7, and 1 and 7: half of each in series.
        self.assertEqual(sorted(set(loaded["stiffness"].round(9))), [1, round(2 / (1 + 1 / 5), 9), 5])
        self.assertEqual(read_vtk(grid)[1]["label"].tolist(), [1, 2, 0, 2, 1, 1])
        self.assertEqual(read_vtk(grid)[1]["mass"].tolist(), [1, 3, 0, 3, 1, 1])
        self.assertEqual(read_vtk(body)[1]["material"].tolist(), [0, 1, 1, 0, 0])

    def test_a_body_lies_where_its_file_puts_it(self):
        scene = self.write("placed.json", {"dataset": {"type": "volume", "file": "placed.nrrd"}, "gravity": [0, 0, -1e-3]})
        place = "space: left-posterior-superior\nspace directions: (0,2,0) (0,0,-3) (4,0,0)\nspace origin: (10,20,30)\n"
        self.write("placed.nrrd", nrrd("3 2 2", [1, 0, 1] * 4, place))
        numpys, grid, body = self.run_scene(scene, ".npz", ".vti", ".vtu", steps=3)
        loaded = numpy.load(numpys)
        axes = numpy.array([[0, 1, 0], [0, 0, -1], [1, 0, 0]], float)
        image, voxels = read_vtk(grid)[:2]
        self.assertEqual(image.GetOrigin(), (10, 20, 30))
        self.assertEqual(image.GetSpacing(), (2, 3, 4))
        matrix = image.GetDirectionMatrix()
        self.assertEqual([[matrix.GetElement(row, axis) for row in range(3)] for axis in range(3)], axes.tolist())
        points = vtk_to_numpy(read_vtk(body)[0].GetPoints().GetData())
        numpy.testing.assert_array_equal(points, loaded["position"] @ axes + (10, 20, 30))
        # The grid's points are where particles were, and its vectors lead to where they are now.
        at = numpy.flatnonzero(voxels["active"])
        rest = numpy.array([image.GetPoint(int(v)) for v in at])
        numpy.testing.assert_allclose(rest + voxels["displacement"][at], points, rtol=0, atol=1e-12)
        self.assertLess(points[:, 0].min(), 10, "gravity along the grid's z is along the file's x")
        self.assertEqual(read_vtk(body)[1]["velocity"].tolist(), (loaded["velocity"] @ axes).tolist())

    def test_a_body_without_springs_opens(self):
        scene = self.write("one.json", {"dataset": {"type": "box", "dims": [1, 1, 1]}, "time_step": 0.1, "gravity": [0, 0, -1]})
        numpys, grid, body = self.run_scene(scene, ".npz", ".vti", ".vtu", steps=3)
        self.assertEqual(numpy.load(numpys)["springs"].shape, (0, 2))
        self.assertEqual(read_vtk(body)[0].GetNumberOfCells(), 0)
        self.assertEqual(read_vtk(body)[0].GetNumberOfPoints(), 1)
        self.assertLess(read_vtk(grid)[1]["displacement"][0][2], 0)

    def test_the_same_state_gives_the_same_bytes(self):
        first = [path.read_bytes() for path in self.run_scene("box@5", *ENDINGS, backend="cpu_reference")]
        again = [path.read_bytes() for path in self.run_scene("box@5", *ENDINGS, backend="cpu_reference")]
        self.assertEqual(first, again)


class Islands(Exported):
    def test_neither_the_report_nor_a_picture_follows_what_nothing_holds(self):
        scene = self.write("island.json", {"dataset": {"type": "volume", "file": "island.nrrd"}, "gravity": [0, 0, -1e-3],
                                           "damping": 0.05, "pinned": {"side": "z-"}})
        active = numpy.zeros((4, 4, 8), numpy.uint8)
        active[:, :, :4] = active[2, 1, 6] = 1
        self.write("island.nrrd", nrrd("8 4 4", active.tobytes()))
        picture, state = self.folder / "body.png", self.folder / "body.npz"
        ran = succeeds("run", scene, "--backend", "cpu_parallel", "--steps", 500, "--out", picture, "--out", state)
        moved = numpy.linalg.norm(numpy.load(state)["displacement"], axis=1)
        alone = numpy.load(state)["voxel"][:, 0] == 6
        self.assertGreater(moved[alone].max(), 10 * moved[~alone].max())
        held, loose = re.search(r"largest displacement (\S+), and (\S+) of the 1 particles that nothing pins", ran.stdout).groups()
        numpy.testing.assert_allclose([float(held), float(loose)], [moved[~alone].max(), moved[alone].max()], rtol=1e-5)
        about = re.search(rb"tEXtvoxspring\0(\{.*?\})", picture.read_bytes())[1]
        self.assertEqual(json.loads(about)["largest"], moved[~alone].max())


class Series(Exported):
    def listed(self, name):
        """(time, path) of each dataset of a collection."""
        root = xml.etree.ElementTree.parse(self.folder / name).getroot()
        self.assertEqual(root.get("type"), "Collection")
        return [(float(d.get("timestep")), self.folder / d.get("file")) for d in root.iter("DataSet")]

    def test_pvd_lists_every_file_with_its_time(self):
        self.run_scene("box@5", ".vtu", ".npz", ".csv", steps=250, every=100)
        time_step = info("box@5")["time_step"]
        steps = (100, 200, 250)
        self.assertEqual(self.listed("body.pvd"), [(s * time_step, self.folder / f"body_{s:06}.vtu") for s in steps])
        for (time, path), step in zip(self.listed("body.pvd"), steps):
            grid, _, _, fields = read_vtk(path)
            self.assertEqual((fields["TimeValue"].tolist(), fields["step"].tolist()), ([time], [step]))
            loaded = numpy.load(path.with_suffix(".npz"))
            self.assertEqual((loaded["time"], loaded["step"]), (time, step))
            self.assert_same(vtk_to_numpy(grid.GetPoints().GetData()), read_csv(path.with_suffix(".csv"))["position"])
        self.assertEqual(sorted(p.name for p in self.folder.iterdir()),
                         sorted(["body.pvd", *(f"body_{s:06}{e}" for s in steps for e in (".vtu", ".npz", ".csv"))]))

    def test_looking_on_the_way_changes_nothing(self):
        self.run_scene(EDITED, ".csv", steps=210)
        self.run_scene(EDITED, ".csv", steps=210, every=30)
        self.assertEqual((self.folder / "body.csv").read_bytes(), (self.folder / "body_000210.csv").read_bytes())

    def test_a_name_may_have_anything_in_it(self):
        name = "a & b <\"c\"> 'd' é"
        out = self.folder / f"{name}.vti"
        self.assertEqual(voxspring("run", "box@3", "--backend", "cpu_reference", "--steps", 1, "--every", 1,
                                   "--out", out).returncode, 0)
        (_, path), = self.listed(f"{name}.pvd")
        self.assertTrue(path.exists(), path)
        read_vtk(path)

    def test_springs_that_are_cut_are_gone_until_they_are_sutured(self):
        self.run_scene(EDITED, ".vtu", ".vti", ".npz", steps=200, every=50)
        total = info(EDITED)["springs"]["total"]

        def springs_after(step):
            grid = read_vtk(self.folder / f"body_{step:06}.vtu")[0]
            found = {tuple(pair) for pair in lines(grid).tolist()}
            loaded = numpy.load(self.folder / f"body_{step:06}.npz")
            self.assertEqual({tuple(pair) for pair in loaded["springs"].tolist()}, found)
            kept = read_vtk(self.folder / f"grid_{step:06}.vti")[1]["springs"]
            ends = numpy.bincount([i for pair in found for i in pair], minlength=len(kept))
            self.assertTrue((kept == ends).all())
            return found, loaded["voxel"]

        before, voxel = springs_after(50)
        self.assertEqual(len(before), total)
        after, _ = springs_after(100)
        gone = before - after
        self.assertTrue(gone)
        self.assertFalse(after - before)
        for i, j in gone:
            # The patch lies between voxels 15 and 16 along x, up to 7.5 along y and from 23.5 along z.
            self.assertEqual({voxel[i][0], voxel[j][0]}, {15, 16})
            self.assertLess(min(voxel[i][1], voxel[j][1]), 7.5)
            self.assertGreater(max(voxel[i][2], voxel[j][2]), 23.5)
        sutured, _ = springs_after(200)
        self.assertEqual(gone & sutured, sutured - after)
        self.assertTrue(gone & sutured)

    def test_a_suture_beyond_the_lattice_is_there(self):
        scene = self.write("sutured.json", {
            "dataset": {"type": "box", "dims": [5, 2, 1]}, "gravity": [0, 0, -1e-3],
            "edits": [{"step": 2, "suture": {"pairs": [[[0, 0, 0], [4, 1, 0]]], "stiffness": 7}}]})
        numpys, body = self.run_scene(scene, ".npz", ".vtu", steps=4, backend="cpu_reference")
        loaded = numpy.load(numpys)
        self.assertEqual(len(loaded["springs"]), info(scene)["springs"]["total"] + 1)
        self.assertEqual(loaded["springs"][-1].tolist(), [0, 9])
        self.assertEqual(loaded["stiffness"][-1], 7)
        # At rest where the particles are at rest.
        self.assertEqual(loaded["rest_length"][-1], numpy.sqrt(17))
        self.assert_same(lines(read_vtk(body)[0]), loaded["springs"].astype(int))


class Refusals(Exported):
    def assert_run_refused(self, arguments, *words):
        self.assert_refused(voxspring("run", "box@5", "--backend", "cpu_parallel", *arguments), *words)
        self.assertEqual(list(self.folder.iterdir()), [])

    def test_before_anything_runs(self):
        good = self.folder / "body.vtu"
        for name in ("body.vtk", "body", "body.vtu.gz", ".vtu"):
            self.assert_run_refused(["--out", good, "--out", self.folder / name], "--out", name, *ENDINGS)
        self.assert_run_refused(["--out", self.folder / "missing" / "body.vti"], "--out", "missing")
        self.assert_run_refused(["--every", 10], "--every", "10", "--out", *ENDINGS)
        self.assert_run_refused(["--out", good, "--out", good.with_suffix(".vti"), "--every", 10], "body.vti", "body.pvd")
        self.assert_run_refused(["--out", good, "--out", f"{self.folder}/./body.vti", "--every", 10], "body.vti", "body.pvd")
        for every in ("0", "-1", "x"):
            self.assert_run_refused(["--out", good, "--every", every], "--every", every)

    def test_a_series_that_diverges_keeps_what_was_good(self):
        scene = self.write("unstable.json", {"dataset": {"type": "box", "dims": [5, 5, 5]}, "time_step": 0.7,
                                             "initial": {"displacement": {"random": 0.001, "seed": 1}}})
        result = voxspring("run", scene, "--backend", "cpu_reference", "--steps", 3000, "--every", 2, "--out",
                           self.folder / "body.vtu")
        self.assertEqual(result.returncode, 1, result.stdout)
        self.assertIn("diverged at step", result.stderr)
        diverged = int(result.stderr.split("diverged at step ")[1].split(":")[0])
        root = xml.etree.ElementTree.parse(self.folder / "body.pvd").getroot()
        names = [d.get("file") for d in root.iter("DataSet")]
        self.assertEqual(names, [f"body_{step:06}.vtu" for step in range(2, diverged, 2)])
        self.assertGreater(len(names), 1)
        self.assertEqual({p.name for p in self.folder.glob("*.vtu")}, set(names))


if __name__ == "__main__":
    unittest.main()
