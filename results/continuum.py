#!/usr/bin/env python3
"""Solves the cases of `voxspring study truth` by finite elements and writes harness/study/continuum.json.

A build does not need this script, since the file is committed. The script needs scikit-fem 12 from PyPI. Lengths are in widths of
the body, stresses in units of Young's modulus; nu is 1/4. Elements are quadratic hexahedra, finer towards the clamped side and its
edges. `error` is the relative difference from the value on a coarser mesh.

The material follows one of these laws, which agree for small strain:
  linear: linear elasticity, for small strain only
  springs: W = E/5 sum_s w_s (|F n_s| - 1)^2 over 3 faces (w = 1) and 6 edges (w = 2): the limit of the lattice as its pitch goes to 0
  neo_hookean, st_venant_kirchhoff: what other programs compute
"""
import json
import sys
from itertools import product
from pathlib import Path

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu
from skfem import Basis, ElementHex2, ElementVector, FacetBasis, Functional, LinearForm, MeshHex, MeshHex2, asm
from skfem.helpers import ddot, dot

ELEMENT = ElementVector(ElementHex2())
LAMBDA = MU = 0.4  # Lame's constants for E = 1 and nu = 1/4
SPRINGS = [(np.eye(3)[a], 1.0) for a in range(3)] + [
    (np.array(n) / np.sqrt(2), 2.0) for n in product((-1, 0, 1), repeat=3) if np.abs(n).sum() == 2 and next(v for v in n if v) > 0]

# symmetric: whether a half about x = 0, and about y = 0, stands for the whole. body: whether the load is a body
# force rather than a traction on the end. load: its size for large strain, along `pattern`.
CASES = {
    "tension": dict(symmetric=(True, True), height=3.0, body=False, load=0.2, pattern="z"),
    "torsion": dict(symmetric=(False, False), height=3.0, body=False, load=0.1, pattern="turn", ends="both", elements=[(5, 7), (6, 8)]),
    "cantilever": dict(symmetric=(False, True), height=4.0, body=True, load=0.2 / 48, pattern="x"),
    "cube": dict(symmetric=(True, True), height=1.0, body=True, load=0.2, pattern="z"),
    "ball": dict(symmetric=(True, True), height=0.75, body=False, load=-0.1, pattern="z", round=True, ends="both", elements=[(3, 7), (5, 10)]),
}
SMALL = 1e-2  # small loads are this fraction of large ones
TINY = 1e-30  # the imaginary step of the complex-step derivative of a stress, which is exact to the last digit


def pattern_of(name, x):
    zero = np.zeros_like(x[0])
    return {"x": np.array([zero + 1, zero, zero]), "z": np.array([zero, zero, zero + 1]), "turn": np.array([-x[1], x[0], zero])}[name]


def graded(low, high, count, power, ends):
    """Points from `low` to `high`. They are denser towards `ends`, which is "lower", "upper" or "both"."""
    t = np.linspace(0, 1, count + 1)
    both = np.where(t < 0.5, 0.5 * (2 * t) ** power, 1 - 0.5 * (2 - 2 * t) ** power)
    return low + (high - low) * {"lower": t ** power, "upper": 1 - (1 - t) ** power, "both": both}[ends]


def mesh_of(case, fine):
    across, along = case.get("elements", [(4, 6), (6, 9)])[fine]
    sides = []
    for symmetric in case["symmetric"]:
        if case.get("round"):
            sides.append(graded(0, 1, across, 1.6, "upper"))
        elif symmetric:
            sides.append(graded(0, 0.5, across // 2 + 1, 2.0, "upper"))
        else:
            sides.append(graded(-0.5, 0.5, across, 1.7, "both"))
    along = along if case["height"] < 2 else round(along * 1.5)
    mesh = MeshHex.init_tensor(*sides, graded(0, case["height"], along, 1.7, case.get("ends", "lower")))
    if not case.get("round"):
        return mesh
    mesh = MeshHex2.from_mesh(mesh)
    x, y, z = mesh.doflocs
    radius = np.sqrt(0.25 - (z - 0.375) ** 2)
    places = np.array([radius * x * np.sqrt(1 - y * y / 2), radius * y * np.sqrt(1 - x * x / 2), z])
    return MeshHex2(places, mesh.t)


def stress(law, gradient):
    """First Piola-Kirchhoff stress for a displacement gradient of shape (3, 3, ...), which may be complex."""
    identity = np.eye(3).reshape(3, 3, *[1] * (gradient.ndim - 2))

    def hooke(e):
        return LAMBDA * np.einsum("kk...->...", e) * identity + 2 * MU * e
    if law == "linear":
        return hooke(0.5 * (gradient + gradient.swapaxes(0, 1)))
    F = gradient + identity
    if law == "springs":
        turned = [(weight, n, np.einsum("ij...,j->i...", F, n)) for n, weight in SPRINGS]
        return sum(0.4 * weight * np.einsum("i...,j->ij...", (1 - 1 / np.sqrt((r * r).sum(axis=0))) * r, n) for weight, n, r in turned)
    if law == "st_venant_kirchhoff":
        return np.einsum("ik...,kj...->ij...", F, hooke(0.5 * (np.einsum("ki...,kj...->ij...", F, F) - identity)))
    matrices = np.moveaxis(F, (0, 1), (-2, -1))
    transposed = np.moveaxis(np.linalg.inv(matrices), (-1, -2), (0, 1))
    return MU * (F - transposed) + LAMBDA * np.log(np.linalg.det(matrices)) * transposed


class Solid:
    """The elements' gradients and quadrature, and the assembly of forces and of their derivative."""

    def __init__(self, mesh):
        self.basis = Basis(mesh, ELEMENT, intorder=5)
        # The axes are: degree of freedom, row, axis, element, point.
        gradients = np.array([function[0].grad for function in self.basis.basis])
        self.b = np.ascontiguousarray(gradients.reshape(81, 9, *self.basis.dx.shape).transpose(2, 3, 1, 0))

    def assemble(self, law, u):
        elements, points = self.basis.dx.shape
        gradient = self.basis.interpolate(u).grad
        pressure = stress(law, gradient)
        tangent = np.empty((elements, points, 9, 9))
        for k, l in product(range(3), repeat=2):
            stepped = gradient.astype(complex)
            stepped[k, l] += TINY * 1j
            tangent[:, :, :, 3 * k + l] = stress(law, stepped).imag.reshape(9, elements, points).transpose(1, 2, 0) / TINY
        weighted = (self.b * self.basis.dx[:, :, None, None]).reshape(elements, -1, 81)
        local = weighted.swapaxes(1, 2) @ (tangent @ self.b).reshape(elements, -1, 81)
        dofs = self.basis.element_dofs.T
        rows, columns = np.broadcast_arrays(dofs[:, :, None], dofs[:, None, :])
        matrix = coo_matrix((local.ravel(), (rows.ravel(), columns.ravel())), (self.basis.N, self.basis.N)).tocsc()
        return asm(LinearForm(lambda v, w: ddot(pressure, v.grad)), self.basis), matrix


def deflection(name, law, load, fine):
    """The mean displacement of the body's free end along the pattern of the load, weighted by the pattern."""
    case = CASES[name]
    mesh = mesh_of(case, fine)
    solid = Solid(mesh)
    basis = solid.basis
    top = mesh.facets_satisfying(lambda x: np.isclose(x[2], case["height"]), boundaries_only=True)
    end = FacetBasis(mesh, ELEMENT, facets=top, intorder=5)
    # The integral of each basis function times the pattern.
    along = LinearForm(lambda v, w: dot(pattern_of(case["pattern"], w.x), v))
    external = load * asm(along, basis if case["body"] else end)
    held = [basis.get_dofs(lambda x, axis=axis: np.isclose(x[axis], 0)).all(f"u^{axis + 1}")
            for axis, symmetric in enumerate(case["symmetric"]) if symmetric]
    free = basis.complement_dofs(basis.get_dofs(lambda x: np.isclose(x[2], 0)).all(), *held)
    u = basis.zeros()
    steps = 1 if law == "linear" or abs(load) < 0.5 * abs(case["load"]) else 5
    for step in range(1, steps + 1):
        for _ in range(20):
            forces, matrix = solid.assemble(law, u)
            residual = (external * step / steps - forces)[free]
            if np.linalg.norm(residual) < 1e-9 * np.linalg.norm(external):
                break
            factors = splu(matrix[free][:, free], permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0, options={"SymmetricMode": True})
            u[free] += factors.solve(residual)
        else:
            raise RuntimeError(f"{name} {law}: Newton's method does not converge")
    size = asm(Functional(lambda w: (pattern_of(case["pattern"], w.x) ** 2).sum(axis=0)), end)
    return float(asm(along, end) @ u / size)


def main(names):
    path = Path(__file__).resolve().parent.parent / "harness" / "study" / "continuum.json"
    known = json.loads(path.read_text()) if path.exists() else {}
    for name in names or CASES:
        case = CASES[name]
        known[name] = {"load": {"small": SMALL * case["load"], "large": case["load"]}, "deflection": {}}
        for law, strain in [("linear", "small"), ("springs", "small"), ("springs", "large"), ("neo_hookean", "large"),
                            ("st_venant_kirchhoff", "large")]:
            load = known[name]["load"][strain]
            values = [deflection(name, law, load, fine) for fine in (False, True)]
            print(name, law, strain, values, flush=True)
            known[name]["deflection"].setdefault(strain, {})[law] = {
                "value": float(f"{values[1]:.7g}"), "error": float(f"{abs(values[1] / values[0] - 1):.1g}")}
            path.write_text(json.dumps(known, indent=2) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
