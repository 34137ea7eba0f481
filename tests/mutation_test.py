"""Mutations of physics, neighbours, layout, edits and kernel: each is caught by conformance and by the error gate.

Builds tests/mutants.cpp from a copy of the sources, for one SIMD target and hardly optimised, and once more after each mutation,
of which only what depends on the mutated file is compiled. What a run is held against comes from the unmutated sources, so that
a mutation of what the reference shares with the backends shows as well. The current directory is the source tree; CXX names the
compiler, ccache is used where it is.
"""

import concurrent.futures
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path.cwd()
CXX = os.environ.get("CXX", "c++")
FLAGS = ["-std=c++20", "-O1", "-ffp-contract=off", "-fopenmp", "-DHWY_COMPILE_ONLY_STATIC", "-DHWY_SHARED_DEFINE", "-I."]
LIBRARIES = ["-fopenmp", "-lhwy"]
SOURCES = ["backends/backend.cpp", "backends/registry.cpp", "backends/rest_policy.cpp", "backends/suggestion.cpp",
           "backends/cpu/*.cpp", "backends/physics/*.cpp", "harness/verification/conserved.cpp",
           "harness/verification/statistics.cpp", "harness/verification/spread.cpp", "harness/verification/verify.cpp",
           "tests/mutants.cpp"]
SPRING, PROBLEM, KERNEL = "backends/physics/spring.h", "backends/physics/problem.cpp", "backends/cpu/kernel.cpp"
PARALLEL, STATE, EDIT = "backends/cpu/cpu_parallel.cpp", "backends/cpu/padded_state.h", "backends/physics/edit.cpp"
NEIGHBOURS = "backends/physics/neighbours.h"

# (what goes wrong, file, from, to); `from` stands there once.
MUTATIONS = [
    ("damping accelerates", SPRING, "* time_step_squared - increment * damping", "* time_step_squared + increment * damping"),
    ("position is not damped", SPRING, "x + ((x - previous) * retained +", "x + ((x - previous) +"),
    ("gravity pulls twice", SPRING, "x + ((x - previous) * retained + (force * inverse_mass + gravity)",
     "x + ((x - previous) * retained + (force * inverse_mass + gravity + gravity)"),
    ("strain is linear", SPRING, "deficit / ((length + rest_length) * length)", "deficit / ((length + length) * length)"),
    ("strain counts the offset twice", SPRING, "dot(relative, rest_offset + offset)", "dot(relative, offset + offset)"),
    ("springs in series are softer", SPRING, "Real(2) / (compliance_a + compliance_b)", "Real(1.9) / (compliance_a + compliance_b)"),
    ("an edge neighbour is another", NEIGHBOURS, "X(8, 1, -1, 0)", "X(8, 1, 1, 0)"),
    ("a diagonal is no edge", NEIGHBOURS, "#define EDGE_BITS 0x0003FFC0u", "#define EDGE_BITS 0x0003FF00u"),
    ("springs along x are missing", PROBLEM, "mask & (problem.group_bits | ACTIVE_BIT)", "mask & (problem.group_bits | ACTIVE_BIT) & ~3u"),
    ("rest lengths are 1% longer", PROBLEM, "            glm::length(glm::dvec3(direction.offset) * grid.spacing);",
     "            1.01 * glm::length(glm::dvec3(direction.offset) * grid.spacing);"),
    ("nothing is pinned", PROBLEM, "pinned[i] != 0 ? mask | PINNED_BIT : mask & ~PINNED_BIT", "mask & ~PINNED_BIT"),
    ("rest offsets point away", PROBLEM, "-glm::dvec3(direction.offset) * problem.lattice.spacing",
     "glm::dvec3(direction.offset) * problem.lattice.spacing"),
    ("the last column is apart", PROBLEM, "n.x >= dims.x ||", "n.x >= dims.x - 1 ||"),
    ("the lower end's rest offset is turned", KERNEL, "place<formulation, L>(task, lower), -rest_offset)",
     "place<formulation, L>(task, lower), rest_offset)"),
    ("loads are left out", KERNEL, "if (task.load[0] != nullptr) force", "if (task.load[0] == task.load[1]) force"),
    ("pinned particles move", KERNEL, "hn::Eq(hn::And(mask, hn::Set(tag, ACTIVE_BIT | PINNED_BIT)), hn::Set(tag, ACTIVE_BIT));",
     "hn::Eq(hn::And(mask, hn::Set(tag, ACTIVE_BIT)), hn::Set(tag, ACTIVE_BIT));"),
    ("a density is the next particle's", KERNEL, "L::load(pair.lower_density + block.in_slice + lane)",
     "L::load(pair.lower_density + block.in_slice + lane + 1)"),
    ("the increment lags by a step", KERNEL, "Lanes3<L> next = here.high + increment;", "Lanes3<L> next = here.high + before;"),
    ("absent springs pull", KERNEL, "select(hn::TestBit(mask, hn::Set(MaskTag<L>(), bit)), force + f, force)",
     "select(hn::TestBit(mask, hn::Set(MaskTag<L>(), MaskOf<T>(ACTIVE_BIT))), force + f, force)"),
    ("full stencils are not looked at", PARALLEL, "return mask == (bits_ | ACTIVE_BIT);", "return mask != 0;"),
    ("edits leave a stencil full", PARALLEL, "block.full_stencil = has_full_stencil(block.first);", "(void)block.first;"),
    ("cuts are ignored", PARALLEL, "= touched.mask;", "|= touched.mask;"),
    ("the time step is 1% longer", PARALLEL, "T(problem_->time_step * problem_->time_step)",
     "T(1.02 * problem_->time_step * problem_->time_step)"),
    ("every group is as stiff as the first", PARALLEL, "T(problem_->group_stiffness[std::size_t(direction.group)])",
     "T(problem_->group_stiffness[0])"),
    ("a cut leaves one end its spring", EDIT, "problem.lattice.mask[changed.spring.second] &= ~(1U << (changed.bit ^ 1));", ""),
    ("masses are all the first's", STATE, "put(inverse_mass, 1 / material.mass);", "put(inverse_mass, 1 / problem.materials[0].mass);"),
    ("loads act along x alone", STATE, "problem.load.empty() ? 0 : problem.load[particle][a]", "problem.load.empty() || a > 0 ? 0 : problem.load[particle][a]"),
]


def run(command, folder):
    done = subprocess.run(list(map(str, command)), cwd=folder, capture_output=True, text=True, timeout=600)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}\n{done.stdout}{done.stderr}")
    return done.stdout


class Copy:
    """The sources in a folder of their own, and the program that is built from them."""

    def __init__(self, folder):
        self.folder = folder
        for top in ("backends", "harness", "tests"):
            shutil.copytree(ROOT / top, folder / top)
        (folder / "roster.h").write_text("#pragma once\n#include <map>\n#include <string>\n"
                                         "inline const std::map<std::string, std::string> left_out_backends = {};\n")
        self.sources = sorted(path.relative_to(folder) for pattern in SOURCES for path in folder.glob(pattern))
        self.compiler = ([shutil.which("ccache")] if shutil.which("ccache") else []) + [CXX]

    def object_of(self, source):
        return str(source).replace("/", "_") + ".o"

    def compile(self, sources):
        with concurrent.futures.ThreadPoolExecutor(JOBS) as pool:
            list(pool.map(lambda source: run([*self.compiler, *FLAGS, "-MD", "-c", source, "-o", self.object_of(source)], self.folder),
                          sources))

    def link(self):
        run([CXX, *map(self.object_of, self.sources), *LIBRARIES, "-o", "mutants"], self.folder)

    def depending_on(self, file):
        """What includes it, by the lists that the compiler left."""
        return [source for source in self.sources
                if file in (self.folder / self.object_of(source)).with_suffix(".d").read_text().split()]

    def caught(self, references):
        """By conformance and by the gate, of six runs each. Who crashes is caught by both."""
        done = subprocess.run([self.folder / "mutants", "check", references], capture_output=True, text=True, timeout=300)
        return tuple(map(int, done.stdout.split())) if done.returncode == 0 else (6, 6)


JOBS = os.cpu_count() or 1


def main():
    for name, file, before, _ in MUTATIONS:
        if (ROOT / file).read_text().count(before) != 1:
            sys.exit(f"mutation '{name}': {file} does not have this once: {before}")
    chosen = [m for m in MUTATIONS if re.search(sys.argv[1] if len(sys.argv) > 1 else "", m[0])]
    escaped = []
    with tempfile.TemporaryDirectory() as folder:
        copy = Copy(pathlib.Path(folder) / "copy")
        copy.compile(copy.sources)
        copy.link()
        references = pathlib.Path(folder) / "references"
        run([copy.folder / "mutants", "write", references], copy.folder)
        if copy.caught(references) != (0, 0):
            sys.exit(f"without a mutation {copy.caught(references)} runs are caught by conformance and by the gate")
        for name, file, before, after in chosen:
            path = copy.folder / file
            original = path.read_text()
            stale = copy.depending_on(file)
            path.write_text(original.replace(before, after))
            copy.compile(stale)
            copy.link()
            conformance, gate = copy.caught(references)
            print(f"{name}: caught in {conformance} of 6 runs by conformance, in {gate} by the gate", flush=True)
            if not conformance or not gate:
                escaped.append(name)
            path.write_text(original)
            copy.compile(stale)  # ccache has them
    if escaped:
        sys.exit("not caught by both: " + ", ".join(escaped))


if __name__ == "__main__":
    main()
