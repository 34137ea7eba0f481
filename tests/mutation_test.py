"""Mutations of physics, neighbours, layout, edits and kernel: each is caught by conformance and by the error gate.

Builds tests/mutants.cpp from a copy of the sources, for one SIMD target and hardly optimised, and once more after each mutation,
of which only what depends on the mutated file is compiled. What a run is held against comes from the unmutated sources, so that
a mutation of what the reference shares with the backends shows as well. The current directory is the source tree; CXX names the
compiler, ccache is used where it is.
"""

import collections
import concurrent.futures
import copy
import os
import pathlib
import queue
import re
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path.cwd()
CXX = os.environ.get("CXX", "c++")
FLAGS = ["-std=c++20", "-O1", "-ffp-contract=off", "-fopenmp", "-DHWY_COMPILE_ONLY_STATIC", "-DHWY_SHARED_DEFINE", "-I."]
LIBRARIES = ["-fopenmp", "-lhwy", "-lfmt"]
SOURCES = [*(f"backends/{name}.cpp" for name in ("api", "backend", "disk_cache", "limits", "registry", "rest_policy", "suggestion")),
           "backends/cpu/*.cpp",
           *(f"backends/layout/{name}.cpp" for name in ("blocks", "border_blocks", "delta_lists", "neighbour_lists", "particles",
                                                        "spring_array", "springs", "tool", "work")),
           "backends/physics/*.cpp", "harness/verification/conserved.cpp", "harness/verification/error_threshold.cpp",
           "harness/verification/verify.cpp", "tests/mutants.cpp"]
MUTANTS = pathlib.Path("tests/mutants.cpp")
SPRING, PROBLEM, KERNEL = "backends/physics/spring.h", "backends/physics/problem.cpp", "backends/cpu/kernel.cpp"
PARALLEL, STATE, EDIT = "backends/cpu/cpu_parallel.cpp", "backends/cpu/padded_state.h", "backends/physics/edit.cpp"
NEIGHBOURS = "backends/physics/neighbours.h"
IMPLICIT, EXPLICIT, DELTA = "cuda/kernels/implicit.h", "cuda/kernels/explicit.h", "cuda/kernels/delta.h"
SCATTER, MOTION, PARTICLES = "cuda/kernels/scatter.h", "cuda/kernels/motion.h", "backends/layout/particles.cpp"
LISTS, DELTAS = "backends/layout/neighbour_lists.cpp", "backends/layout/delta_lists.cpp"

# The strategies of mutants.cpp that step by the code of a file; cpu_parallel if none is named.
STRATEGIES = {IMPLICIT: ["implicit", "tile"], EXPLICIT: ["groups", "springs"], DELTA: ["delta"], SCATTER: ["scatter"],
              MOTION: ["implicit"], PARTICLES: ["implicit"], LISTS: ["groups", "springs"], DELTAS: ["delta"]}
CPU = ["cpu_parallel"]
EVERY = [*CPU, *dict.fromkeys(name for names in STRATEGIES.values() for name in names)]

# (what goes wrong, file, from, to); `from` occurs there exactly once.
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
    ("nothing is pinned", PROBLEM, "pinned[std::size_t(i)] != 0 ? mask | PINNED_BIT : mask & ~PINNED_BIT", "mask & ~PINNED_BIT"),
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
    ("edges are as stiff as faces", IMPLICIT, "sums.edge * step.stiffness[1])", "sums.edge * step.stiffness[0])"),
    ("the slice above is the one below", IMPLICIT, "index + dy * row + dz * slice, dx);", "index + dy * row - dz * slice, dx);"),
    ("compliance is that of a neighbour's row", IMPLICIT, "compliance[index + dy * row + dz * slice + dx]",
     "compliance[index + dy * row + dz * slice]"),
    ("a tile's slices are turned round", IMPLICIT, "tile.get(0, 1 + dz, ty + 1 + dy, tx + 1 + dx);",
     "tile.get(0, 1 - dz, ty + 1 + dy, tx + 1 + dx);"),
    ("a tile's frame lacks a column", IMPLICIT, "if (right) load(W + 1, ty + 1, index + 1, slice, current);", ""),
    ("six edges of twelve pull", EXPLICIT, "if (GroupCounters::count(self.bits, 1) > list_chunk)",
     "if (GroupCounters::count(self.bits, 1) > 2 * list_chunk)"),
    ("the secondary list's stiffness is left out", EXPLICIT, "pull.density * constants[s].stiffness, force);", "pull.density, force);"),
    ("every group starts at slot 0", EXPLICIT, "step.first_slot[g] + s, short_chunk", "s, short_chunk"),
    ("gaps in a row are overlooked", DELTA, "dx > 0 && number < row_count", "dx > 1 && number < row_count"),
    ("rows before the fifth are the fourth", DELTA, "near.row[row] :", "near.row[3] :"),
    ("one end feels no force along y", SCATTER, "add_atomically(second + step.pitch, -force.y);", ""),
    ("forces of all steps add up", SCATTER, "store_axes(sum, step.pitch, Vector<Real>{0, 0, 0});", ""),
    ("damping is twice as strong", MOTION, "gravity, motion.damping, squared)", "gravity, motion.damping + motion.damping, squared)"),
    ("pins hold no increment", MOTION, "return {{pinned ? at : u}, {v, {}}};", "return {{u + v}, {v, {}}};"),
    ("loads are another particle's", MOTION, "force + motion.load[index]", "force + motion.load[index / 2]"),
    ("masses on the card are all the first's", PARTICLES, "inverse[placement.at(i)] = Real(1 / problem.material_of(i).mass)",
     "inverse[placement.at(i)] = Real(1 / problem.materials[0].mass)"),
    ("x(t - dt) is x(t)", PARTICLES, "{vector_of<Real>(point - state.increment_of(i)), word_bits}", "{vector_of<Real>(point), word_bits}"),
    ("lists hold every stiffness as 1", LISTS, "lists.constants[at] = {Real(stiffness), rest_length};", "lists.constants[at] = {Real(1), rest_length};"),
    ("a list starts a particle late", DELTAS, "starts |= 1U << i % slice_particles", "starts |= 2U << i % slice_particles"),
    ("loads act along x alone", STATE, "problem.load.empty() ? 0 : problem.load[particle][a]", "problem.load.empty() || a > 0 ? 0 : problem.load[particle][a]"),
]


def run(command, folder):
    done = subprocess.run(list(map(str, command)), cwd=folder, capture_output=True, text=True, timeout=600)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}\n{done.stdout}{done.stderr}")
    return done.stdout


class Copy:
    """A copy of the sources in `folder`, and the program that is built from them."""

    def __init__(self, folder):
        self.folder = folder
        for top in ("backends", "cuda", "harness", "tests"):
            shutil.copytree(ROOT / top, folder / top)
        (folder / "roster.h").write_text("#pragma once\n#include <map>\n#include <string>\n"
                                         "inline const std::map<std::string, std::string> left_out_backends = {};\n")
        self.sources = sorted(path.relative_to(folder) for pattern in SOURCES for path in folder.glob(pattern))
        self.compiler = ([shutil.which("ccache")] if shutil.which("ccache") else []) + [CXX]
        self.restored = set()  # sources whose objects still contain the previous mutation
        self.strategies = EVERY  # the strategies that are built in

    def twin(self, folder):
        """Another copy, with the objects of this one."""
        other = copy.copy(self)
        other.folder, other.restored = shutil.copytree(self.folder, folder), set()
        return other

    def object_of(self, source):
        return str(source).replace("/", "_") + ".o"

    def compile_one(self, source):
        strategies = [f'-DSTRATEGIES="{" ".join(self.strategies)}"'] if source == MUTANTS else []
        run([*self.compiler, *FLAGS, *strategies, "-MD", "-c", source, "-o", self.object_of(source)], self.folder)

    def link(self):
        run([CXX, *map(self.object_of, self.sources), *LIBRARIES, "-o", "mutants"], self.folder)

    def depending_on(self, file):
        """The sources that include `file`, by the compiler's dependency lists."""
        return {source for source in self.sources
                if file in (self.folder / self.object_of(source)).with_suffix(".d").read_text().split()}

    def caught(self, references, strategies):
        """In how many runs conformance catches it, whether the gate does, and the number of runs. A crash counts as caught by both."""
        done = subprocess.run([self.folder / "mutants", "check", references, *strategies], capture_output=True, text=True,
                              timeout=300, env=os.environ | {"OMP_NUM_THREADS": "1"})
        if done.returncode == 3:
            sys.exit(f"of {strategies} not all are built in")
        return tuple(map(int, done.stdout.split())) if done.returncode == 0 else (1, 1, 1)

    def caught_of(self, mutation, references):
        """What caught() says of a mutation, with only the strategies that step by its file. Sources of the mutation before, mostly
        the same ones, are compiled again with it."""
        _, file, before, after = mutation
        path = self.folder / file
        original = path.read_text()
        stale = self.depending_on(file)
        path.write_text(original.replace(before, after))
        compiled = stale | self.restored
        if self.strategies != STRATEGIES.get(file, CPU):
            self.strategies = STRATEGIES.get(file, CPU)
            compiled.add(MUTANTS)
        for source in sorted(compiled):
            self.compile_one(source)
        self.link()
        path.write_text(original)
        self.restored = stale
        return self.caught(references, self.strategies)


JOBS = os.cpu_count() or 1


def try_all(one, mutations, references):
    """The names of the mutations that escaped."""
    escaped = []
    for mutation in mutations:
        conformance, gate, runs = one.caught_of(mutation, references)
        print(f"{mutation[0]}: caught in {conformance} of {runs} runs by conformance, {'and' if gate else 'not'} by the gate", flush=True)
        if not conformance or not gate:
            escaped.append(mutation[0])
    return escaped


def try_groups(one, groups, references):
    """The escaped mutations of `groups`, from which other copies take as well, until none is left."""
    escaped = []
    while True:
        try:
            escaped += try_all(one, groups.get_nowait(), references)
        except queue.Empty:
            return escaped


def main():
    for name, file, before, _ in MUTATIONS:
        if (ROOT / file).read_text().count(before) != 1:
            sys.exit(f"mutation '{name}': {file} does not have this once: {before}")
    chosen = [m for m in MUTATIONS if re.search(sys.argv[1] if len(sys.argv) > 1 else "", m[0])]
    # Mutations of one file follow each other, since they compile the same sources.
    files = collections.Counter(mutation[1] for mutation in chosen)
    with tempfile.TemporaryDirectory() as folder, concurrent.futures.ThreadPoolExecutor(JOBS) as pool:
        first = Copy(pathlib.Path(folder) / "0")
        list(pool.map(first.compile_one, first.sources))
        first.link()
        references = pathlib.Path(folder) / "references"
        run([first.folder / "mutants", "write", references], first.folder)
        parts = [EVERY[n::JOBS] for n in range(JOBS) if EVERY[n::JOBS]]
        conformance, gate, runs = map(sum, zip(*pool.map(lambda part: first.caught(references, part), parts)))
        if conformance or gate or runs < len(EVERY):
            sys.exit(f"without a mutation {conformance} of {runs} runs are caught by conformance, {gate and 'one' or 'none'} by the gate")
        copies = [first] + [first.twin(pathlib.Path(folder) / str(n)) for n in range(1, JOBS)]
        # The longest groups come first, so that no copy is left with one at the end.
        groups = queue.SimpleQueue()
        for file in sorted(files, key=lambda file: -files[file] * (1 + len(first.depending_on(file)))):
            groups.put([mutation for mutation in chosen if mutation[1] == file])
        escaped = sum(pool.map(lambda one: try_groups(one, groups, references), copies), [])
    if escaped:
        sys.exit("not caught by both: " + ", ".join(escaped))


if __name__ == "__main__":
    main()
