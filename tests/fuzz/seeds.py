"""Writes the seeds that the fuzzers start from: seeds.py FOLDER.

FOLDER/NAME/ gets the seeds of the fuzzer NAME, FOLDER itself the volume that scene seeds name, the data that
headers name, and FOLDER/NAME.dict the words that the fuzzer's files are made of.
"""

import bz2
import gzip
import json
import pathlib
import struct
import sys
import zlib

VOXELS = bytes([0, 1, 1, 2, 0, 2, 1, 2])
BOX = {"type": "box", "dims": [4, 3, 2]}

SCENES = [
    {"dataset": BOX},
    {"dataset": {"type": "heart", "dims": [12, 11, 10]}, "pinned": {"side": "x-", "fraction": 0.35},
     "gravity": [8e-4, 0, -2e-3], "damping": 0.00115, "time_step": {"fraction_of_stable": 0.5}},
    {"dataset": BOX, "spring_groups": ["face", "corner"], "stiffness": {"face": 1, "corner": 0.5},
     "spacing": [1, 2, 0.5], "mass": 2, "time_step": 0.01},
    {"dataset": BOX, "pinned": [{"side": "z-", "slices": 1}, {"from": [0, 0, 0], "to": [1, 1, 1]}],
     "initial": {"displacement": {"random": 0.1, "seed": 7}, "velocity": [1, 0, 0]},
     "loads": [{"voxel": [3, 2, 1], "force": [0, 0, 1]}]},
    {"dataset": BOX, "initial": {"displacement": {"vector": [0.1, 0, 0], "from": [0, 0, 0], "to": [1, 1, 1]},
                                 "velocity": {"random": 0.1, "seed": 7, "side": "x+", "fraction": 0.5}}},
    {"dataset": {"type": "volume", "file": "volume.nrrd", "threshold": 1}, "spacing": 3},
    {"dataset": {"type": "volume", "file": "volume.nrrd", "labels": [1, 2]},
     "mass": {"1": 1, "2": 2}, "stiffness": {"1": 1, "2": 0.25}},
]

SCHEMA = pathlib.Path(__file__).parents[2] / "results" / "scene.schema.json"

NRRD_WORDS = [
    "NRRD0004", "NRRD0005", "type: ", "uint8", "int16", "unsigned short", "float", "double", "long long",
    "dimension: ", "sizes: ", "encoding: ", "raw", "gzip", "endian: ", "little", "big", "spacings: ", "nan", "inf",
    "space directions: ", "none", "(1,0,0) (0,1,0) (0,0,1)", "data file: ", "line skip: ", "byte skip: ", ":=", "#",
    "bzip2", "kinds: ", "domain", "space", "scalar", "RGB-color", "LIST", "voxels.raw", "-1", "space origin: ", "units: ", "\"um\"", "Segment0_Name:=", "Segment0_ID:=", "_LabelValue:=",
    "_Layer:=", "wall",
]

SEGMENTS = (
    "NRRD0004\ntype: uint8\ndimension: 4\nspace: left-posterior-superior\nsizes: 2 2 2 2\n"
    "space directions: none (1,0,0) (0,1,0) (0,0,-1)\nkinds: list domain domain domain\nencoding: raw\n"
    "space origin: (1,2,3)\nSegment0_ID:=Segment_1\nSegment0_Name:=wall\nSegment0_LabelValue:=1\n"
    "Segment0_Layer:=0\nSegment1_ID:=Segment_2\nSegment1_Name:=valve\nSegment1_LabelValue:=1\n"
    "Segment1_Layer:=1\n\n")

METAIMAGE_WORDS = [
    "NDims = ", "DimSize = ", "ElementType = ", "MET_UCHAR", "MET_SHORT", "MET_DOUBLE", "ElementSpacing = ", "ElementSize = ",
    "CompressedData = ", "BinaryData = ", "BinaryDataByteOrderMSB = ", "True", "False", "HeaderSize = ", "-1",
    "ElementNumberOfChannels = ", "TransformMatrix = ", "Offset = ", "AnatomicalOrientation = ", "LPS", "DistanceUnits = ",
    "ElementToIntensityFunctionSlope = ", "ElementDataFile = ", "LOCAL", "LIST", "voxels.raw", "nan", "inf", "ObjectType = Image",
]


def nrrd(kind, order, encoding, more, data):
    header = f"NRRD0004\ntype: {kind}\ndimension: 3\nsizes: 2 2 2\nendian: {order}\nencoding: {encoding}\n{more}\n"
    return header.encode() + data


def nifti(order, datatype, data, spacing=(1, 1, 1), slope=0.0):
    header = struct.pack(order + "i36x8h14xh4x8f3f", 348, 3, 2, 2, 2, 1, 1, 1, 1, datatype, 1, *spacing, 0, 0, 0, 0,
                         352, slope, 0)
    return header.ljust(344, b"\0") + b"n+1\0" + b"\0" * 4 + data


def nifti2(order, datatype, data, magic=b"n+2", offset=544):
    header = struct.pack(order + "i4s4shh8q3d8dq2d", 540, magic, b"\r\n\x1a\n", datatype, 8, 3, 2, 2, 2, 1, 1, 1, 1,
                         0, 0, 0, 1, 1, -2, 0.5, 0, 0, 0, 0, offset, 0, 0)
    return header.ljust(544 if offset else 540, b"\0") + data


def metaimage(kind, more, data, place="LOCAL"):
    header = f"ObjectType = Image\nNDims = 3\nDimSize = 2 2 2\nElementType = {kind}\n{more}ElementDataFile = {place}\n"
    return header.encode() + data


def scalars(order, code):
    return struct.pack(order + str(len(VOXELS)) + code, *VOXELS)


POINTS = [(0, 0, 0), (2, 0, 0), (0, 2, 0), (0, 0, 2)]
TRIANGLES = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)]
MESH_WORDS = {
    "stl": ["solid", "facet normal 0 0 1", "outer loop", "vertex ", "endloop", "endfacet", "endsolid", "nan", "1e300"],
    "obj": ["v ", "f ", "vt ", "vn ", "f -1 -2 -3", "/", "//", "nan", "inf"],
    "ply": ["ply", "format ", "ascii 1.0", "binary_little_endian 1.0", "binary_big_endian 1.0", "element vertex ", "element face ",
            "property ", "list ", "uchar ", "short ", "int ", "float ", "double ", " x", " y", " z", "vertex_indices", "end_header"],
    "vtk": ["# vtk DataFile Version 5.1", "ASCII", "BINARY", "DATASET ", "POLYDATA", "UNSTRUCTURED_GRID", "POINTS ", "POLYGONS ", "CELLS ",
            "CELL_TYPES ", "OFFSETS vtktypeint64", "CONNECTIVITY vtktypeint64", "METADATA", "FIELD FieldData 1", "float", "double", "int", "10"],
    "msh": ["$MeshFormat", "2.2 0 8", "4.1 0 8", "4.1 1 8", "$EndMeshFormat", "$Nodes", "$EndNodes", "$Elements", "$EndElements", " 4 ", " 2 "],
}


def meshes():
    """A tetrahedron in every format, by its ending."""
    corners = [[POINTS[n] for n in triangle] for triangle in TRIANGLES]
    text = lambda rows: "".join(" ".join(map(str, row)) + "\n" for row in rows)
    facets = "".join("facet normal 0 0 0\nouter loop\n" + "".join(f"vertex {x} {y} {z}\n" for x, y, z in triangle) + "endloop\nendfacet\n"
                     for triangle in corners)
    header = ("ply\nformat {} 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 4\n"
              "property list uchar int vertex_indices\nend_header\n")
    faces = [(3, *triangle) for triangle in TRIANGLES]
    vtk = "# vtk DataFile Version {}\n\n{}\nDATASET {}\nPOINTS 4 float\n"
    nodes = [(n + 1, *point) for n, point in enumerate(POINTS)]
    return {
        "stl": [f"solid\n{facets}endsolid\n".encode(),
                struct.pack("<80xI", 4) + b"".join(struct.pack("<12x9f2x", *sum(triangle, ())) for triangle in corners)],
        "obj": [(text(("v", *point) for point in POINTS) + text(("f", *(n + 1 for n in triangle)) for triangle in TRIANGLES)).encode()],
        "ply": [(header.format("ascii") + text(POINTS) + text(faces)).encode()] +
               [header.format(f"binary_{name}_endian").encode() + b"".join(struct.pack(order + "3f", *point) for point in POINTS) +
                b"".join(struct.pack(order + "B3i", *face) for face in faces) for name, order in (("little", "<"), ("big", ">"))],
        "vtk": [(vtk.format("3.0", "ASCII", "POLYDATA") + text(POINTS) + "POLYGONS 4 16\n" + text(faces)).encode(),
                (vtk.format("5.1", "ASCII", "POLYDATA") + text(POINTS) + "METADATA\nINFORMATION 0\n\nPOLYGONS 5 12\nOFFSETS vtktypeint64\n"
                 "0 3 6 9 12\nCONNECTIVITY vtktypeint64\n" + text(TRIANGLES)).encode(),
                vtk.format("3.0", "BINARY", "UNSTRUCTURED_GRID").encode() + b"".join(struct.pack(">3f", *point) for point in POINTS) +
                b"\nCELLS 1 5\n" + struct.pack(">5i", 4, 0, 1, 2, 3) + b"\nCELL_TYPES 1\n" + struct.pack(">i", 10)],
        "msh": [("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n" + text(nodes) + "$EndNodes\n$Elements\n1\n1 4 2 0 1 1 2 3 4\n"
                 "$EndElements\n").encode(),
                ("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 4 1 4\n3 1 0 4\n1\n2\n3\n4\n" + text(POINTS) +
                 "$EndNodes\n$Elements\n1 1 1 1\n3 1 4 1\n1 1 2 3 4\n$EndElements\n").encode(),
                b"$MeshFormat\n4.1 1 8\n" + struct.pack("<i", 1) + b"\n$EndMeshFormat\n$Nodes\n" +
                struct.pack("<4Q3iQ4Q12d", 1, 4, 1, 4, 3, 1, 0, 4, 1, 2, 3, 4, *sum(POINTS, ())) + b"\n$EndNodes\n$Elements\n" +
                struct.pack("<4Q3iQ5Q", 1, 1, 1, 1, 3, 1, 4, 1, 1, 1, 2, 3, 4) + b"\n$EndElements\n"],
    }


def quoted(words):
    return "".join(json.dumps(word) + "\n" for word in words)


def words_of(schema):
    """The keys and the words that a schema names."""
    if isinstance(schema, list):
        return set().union(*map(words_of, schema))
    if not isinstance(schema, dict):
        return set()
    words = set(schema.get("properties", ())) | {word for word in schema.get("enum", ()) if isinstance(word, str)}
    return words.union({schema["const"]} if isinstance(schema.get("const"), str) else (), *map(words_of, schema.values()))


def main():
    folder = pathlib.Path(sys.argv[1])
    seeds = {"scene": [json.dumps(scene).encode() for scene in SCENES]}
    directions = "space: left-posterior-superior\nspace directions: (0,2,0) (1,0,0) (0,0,0.5)\n"
    seeds["nrrd"] = [
        nrrd("uint8", "little", "raw", "spacings: 1 2 0.5\n", VOXELS),
        nrrd("short", "big", "raw", directions, scalars(">", "h")),
        nrrd("double", "little", "gzip", "key:=value\n# comment\n", gzip.compress(scalars("<", "d"), mtime=0)),
        nrrd("float", "little", "bz2", "kinds: domain domain space\n", bz2.compress(scalars("<", "f"))),
        nrrd("uint8", "little", "raw", "byte skip: -1\ndata file: voxels.raw\n", b""),
        nrrd("uint8", "little", "gzip", "byte skip: -1\n", gzip.compress(VOXELS, mtime=0) + b"\0\n"),
        SEGMENTS.encode() + VOXELS * 2,
        nrrd("uint8", "little", "raw", "line skip: 0\ndata file: LIST\nvoxels.raw\n", b""),
    ]
    seeds["nifti"] = [
        nifti("<", 2, VOXELS),
        nifti(">", 4, scalars(">", "h"), (1, 2, 0.5), 2.0),
        nifti("<", 64, scalars("<", "d")),
        gzip.compress(nifti("<", 16, scalars("<", "f")), mtime=0),
        nifti2("<", 2, VOXELS),
        nifti2(">", 4, scalars(">", "h")),
        nifti2("<", 2, b"", b"ni2", 0),  # its image is volume.img
    ]
    seeds["metaimage"] = [
        metaimage("MET_UCHAR", "ElementSpacing = 1 2 0.5\n", VOXELS),
        metaimage("MET_SHORT", "BinaryDataByteOrderMSB = True\n", scalars(">", "h")),
        metaimage("MET_DOUBLE", "CompressedData = True\nCompressedDataSize = 20\n", zlib.compress(scalars("<", "d"))),
        metaimage("MET_UCHAR", "TransformMatrix = 1 0 0 0 -1 0 0 0 1\nOffset = 1 2 3\nDistanceUnits = um\n", VOXELS),
        metaimage("MET_UCHAR", "ElementNumberOfChannels = 2\nAnatomicalOrientation = RAI\n", VOXELS * 2),
        metaimage("MET_UCHAR", "HeaderSize = -1\n", b"", "voxels.raw"),
        metaimage("MET_UCHAR", "", b"voxels.raw\n", "LIST"),
    ]
    seeds.update(meshes())
    for name, files in seeds.items():
        (folder / name).mkdir(parents=True, exist_ok=True)
        for number, data in enumerate(files):
            (folder / name / f"seed{number}").write_bytes(data)
    (folder / "volume.nrrd").write_bytes(seeds["nrrd"][0])
    (folder / "volume.img").write_bytes(VOXELS)
    (folder / "voxels.raw").write_bytes(VOXELS)
    words = words_of(json.loads(SCHEMA.read_text())) | {"$schema", "volume.nrrd"}
    (folder / "scene.dict").write_text(quoted(sorted(words)))
    (folder / "nrrd.dict").write_text(quoted(NRRD_WORDS))
    (folder / "nifti.dict").write_text(quoted(["n+1", "ni1", "n+2", "ni2"]))
    (folder / "metaimage.dict").write_text(quoted(METAIMAGE_WORDS))
    for name, words in MESH_WORDS.items():
        (folder / f"{name}.dict").write_text(quoted(words))


if __name__ == "__main__":
    main()
