"""An open scan becomes a body, and its mesh comes back deformed."""

import re
import resource
import struct
import unittest

import matplotlib.image
import numpy
from program import InTemporaryFolder, json_of, nrrd, succeeds, voxspring

# Two cores for ten seconds, which is what the promise of docs/organ.md costs at most.
CPU_SECONDS = 20


def organ(rings):
    """A closed surface that resembles a liver, of 4 rings^2 triangles: points and triangles, in millimetres."""
    theta, phi = numpy.meshgrid(numpy.linspace(0, numpy.pi, rings + 1)[1:-1], numpy.arange(2 * rings) * numpy.pi / rings, indexing="ij")
    direction = numpy.stack([numpy.sin(theta) * numpy.cos(phi), numpy.sin(theta) * numpy.sin(phi), numpy.cos(theta)], -1).reshape(-1, 3)
    direction = numpy.concatenate([direction, [[0, 0, 1], [0, 0, -1]]])
    x, y, z = direction.T
    noise = numpy.random.default_rng(7).normal(0, 0.003, len(direction))
    radius = 60 + 14 * numpy.sin(3 * x + 1) * numpy.cos(2 * y) + 9 * z * x + 60 * noise
    points = direction * radius[:, None] * [1.5, 1, 0.8] + [310, -120, 45]
    row, column = numpy.meshgrid(numpy.arange(rings - 2), numpy.arange(2 * rings), indexing="ij")
    a, b = row * 2 * rings + column, row * 2 * rings + (column + 1) % (2 * rings)
    c, d = a + 2 * rings, b + 2 * rings
    ring = numpy.arange(2 * rings)
    last = (rings - 2) * 2 * rings
    north, south = len(points) - 2, len(points) - 1
    triangles = numpy.concatenate([
        numpy.stack([a, c, b], -1).reshape(-1, 3), numpy.stack([b, c, d], -1).reshape(-1, 3),
        numpy.stack([numpy.full_like(ring, north), ring, (ring + 1) % (2 * rings)], -1),
        numpy.stack([numpy.full_like(ring, south), last + (ring + 1) % (2 * rings), last + ring], -1)])
    return points, triangles


def volume_of(points, triangles):
    a, b, c = (points[triangles[:, n]] - points.mean(0) for n in range(3))
    return float((a * numpy.cross(b, c)).sum() / 6)


def write_ply(path, points, triangles):
    header = (f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\nproperty float x\nproperty float y\n"
              f"property float z\nelement face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n")
    faces = numpy.zeros(len(triangles), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, triangles
    path.write_bytes(header.encode() + points.astype("<f4").tobytes() + faces.tobytes())


def read_ply(path):
    """The points and triangles of a file that voxspring wrote."""
    head, body = path.read_bytes().split(b"end_header\n", 1)
    vertices, faces = (int(number) for number in re.findall(rb"element \w+ (\d+)", head))
    points = numpy.frombuffer(body, "<f8", 3 * vertices).reshape(-1, 3)
    rows = numpy.frombuffer(body, [("count", "u1"), ("corners", "<u4", 3)], faces, offset=points.nbytes)
    return points, rows["corners"]


class Organ(InTemporaryFolder):
    @classmethod
    def setUpClass(cls):
        cls.points, cls.triangles = organ(160)
        cls.volume = volume_of(cls.points, cls.triangles)
        # Five patches are missing, of a tenth to a fifth of the length; some of the rest is turned over.
        centre = cls.points.mean(0)
        middle = cls.points[cls.triangles].mean(1)
        is_missing = numpy.zeros(len(middle), bool)
        for n, direction in enumerate(([1, 0, 0.2], [-1, 0.3, 0], [0, 1, 0.4], [0.2, -1, 0], [0.1, 0.3, -1])):
            ray = numpy.array(direction) / numpy.linalg.norm(direction)
            hit = cls.points[numpy.argmax((cls.points - centre) @ ray)]
            is_missing |= numpy.linalg.norm(middle - hit, axis=1) < 9 + 2 * n
        cls.open = cls.triangles[~is_missing]
        cls.open[:1500] = cls.open[:1500, ::-1]

    def scan(self):
        path = self.folder / "scan.ply"
        write_ply(path, self.points, self.open)
        return path

    def ball(self, rings=12):
        """The path of a smaller organ, its points and its triangles."""
        path, (points, triangles) = self.folder / "small.ply", organ(rings)
        write_ply(path, points, triangles)
        return path, points, triangles

    def test_an_open_scan_becomes_a_body_and_comes_back(self):
        scan, out = self.scan(), self.folder / "deformed.ply"
        self.assertGreater(len(self.open), 95_000)
        facts = json_of("info", scan, "--pitch", 3, "--json")
        mesh = facts["mesh"]
        self.assertEqual(mesh["holes"], 5)
        self.assertEqual(mesh["turned_triangles"], 1500)
        self.assertAlmostEqual(mesh["body_volume"], facts["active_particles"] * 27, delta=1e-6 * self.volume)
        for key in ("body_volume", "volume", "volume_by_divergence"):
            self.assertLess(abs(mesh[key] / self.volume - 1), 0.01, key)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        ran = succeeds("run", scan, "--pitch", 3, "--steps", 100, "--backend", "cpu_parallel", "--out", out)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        self.assertLess(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, CPU_SECONDS)
        self.assertIn("5 holes", ran.stderr)
        points, triangles = read_ply(out)
        self.assertTrue((triangles == self.open).all())
        moved = numpy.linalg.norm(points - self.points.astype("f4"), axis=1)
        largest = float(re.search(r"largest displacement ([0-9.e+-]+)", ran.stdout)[1])
        # A mesh extrapolates by up to a voxel beyond the particles.
        self.assertGreater(moved.max(), 0.9 * largest)
        self.assertLess(moved.max(), 1.2 * largest)

    def test_particles_at_corners_are_refused(self):
        ball, *_ = self.ball()
        refused = voxspring("run", ball, "--pitch", 12, "--steps", 1, "--backend", "cpu_reference", "--corners", "--out", self.folder / "body.ply")
        self.assertEqual(refused.returncode, 2)
        self.assertIn("particles: corners", refused.stderr)

    def test_every_format_comes_in_and_goes_out_per_frame(self):
        ball, points, triangles = self.ball()
        outs = [option for ending in ("stl", "obj", "ply", "mesh.vtu") for option in ("--out", self.folder / f"body.{ending}")]
        succeeds("run", ball, "--pitch", 12, "--steps", 4, "--every", 2, "--backend", "cpu_reference", *outs)
        series = sorted(path.name for path in self.folder.iterdir())
        self.assertEqual(series, ["body.mesh.pvd", *(f"body_00000{n}.{ending}" for n in (2, 4) for ending in ("mesh.vtu", "obj", "ply", "stl")),
                                  "small.ply"])
        moved, corners = read_ply(self.folder / "body_000004.ply")
        self.assertTrue((corners == triangles).all())
        text = (self.folder / "body_000004.obj").read_text().split("\n")
        self.assertTrue((numpy.array([line.split()[1:] for line in text if line.startswith("v")], float) == moved).all())
        facets = numpy.frombuffer((self.folder / "body_000004.stl").read_bytes()[84:],
                                  [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
        self.assertTrue((facets["corners"] == moved[triangles].astype("f4")).all())
        edges = facets["corners"][:, 1:] - facets["corners"][:, :1]
        self.assertGreater((numpy.cross(edges[:, 0], edges[:, 1]) * facets["normal"]).sum(1).min(), 0)
        vtu = (self.folder / "body_000004.mesh.vtu").read_bytes()
        self.assertIn(moved.tobytes(), vtu)
        # What went out comes in again.
        for ending in ("stl", "obj", "ply"):
            mesh = json_of("info", self.folder / f"body_000004.{ending}", "--json")["mesh"]
            self.assertEqual((mesh["triangles"], mesh["vertices"], mesh["open_edges"]), (len(triangles), len(points), 0))

    def test_a_picture_shows_the_mesh(self):
        ball, *_ = self.ball(40)
        areas = []
        for pitch in (6, 24):
            out = self.folder / f"{pitch}.png"
            succeeds("run", ball, "--pitch", pitch, "--steps", 1, "--backend", "cpu_reference", "--size", "320x240",
                     "--gravity", "0,0,0", "--out", out)
            areas.append(float((matplotlib.image.imread(out)[:, :200, 3] > 0.5).mean()))
        self.assertGreater(areas[0], 0.1)
        # Cubes of a sixth of the body would show; the mesh is the same to the pixel but for its legend.
        self.assertAlmostEqual(areas[0], areas[1], delta=0.002)

    def test_a_scene_file_names_a_mesh_and_a_body_of_voxels_has_a_surface(self):
        self.ball()
        scene = self.write("scene.json", {"dataset": {"type": "mesh", "file": "small.ply", "pitch": 12, "fill": 0.3},
                                          "pinned": {"side": "x-"}, "gravity": [0, 0, -1]})
        mesh = json_of("info", scene, "--json")["mesh"]
        self.assertEqual((mesh["pitch"], mesh["fill"]), (12, 0.3))
        out = self.folder / "box.ply"
        succeeds("run", "box@4", "--steps", 1, "--backend", "cpu_reference", "--out", out)
        corners, sides = read_ply(out)
        self.assertEqual(len(sides), 2 * 6 * 16)
        self.assertGreater(volume_of(corners, sides.astype(int)), 50)  # 64 less its rounded edges

    def test_what_is_no_organ_is_refused(self):
        ball, *_ = self.ball()
        for options, words in ((["--pitch", 1000], ["--pitch", "about 2.", "x"]), (["--pitch", 0.001], ["--pitch", "about 2."]),
                               (["--labels", 1], ["--labels", "no such option"]), (["--spacing", 1], ["--spacing", "--pitch"]),
                               (["--fill", 2], ["--fill"]), (["--pitch", 0], ["--pitch"])):
            self.assert_refused(voxspring("info", ball, *options), *words)
        volume = self.write("body.nrrd", nrrd("4 4 2", [1] * 32, "spacings: 1 1 2\n"))
        self.assert_refused(voxspring("info", volume, "--fill", 0.5), "--fill", "--pitch")
        facts = json_of("info", volume, "--pitch", 2, "--json")
        self.assertEqual((facts["dims"], facts["active_particles"]), ([2, 2, 2], 8))
        self.assert_refused(voxspring("info", self.write("empty.stl", struct.pack("<80xI", 0))), "empty.stl", "no triangle")


if __name__ == "__main__":
    unittest.main()
