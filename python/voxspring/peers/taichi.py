"""Taichi: a kernel whose outermost loop is parallel."""

import numpy as np
import taichi as ti

vectors, numbers = ti.types.ndarray(dtype=ti.math.vec3, ndim=1), ti.types.ndarray(dtype=ti.f32, ndim=1)


@ti.kernel
def one_step(x: vectors, v: vectors, x_new: vectors, neighbours: ti.types.ndarray(dtype=ti.i32, ndim=2),
             stiffness: ti.types.ndarray(dtype=ti.f32, ndim=2), lengths: numbers, load: vectors, inverse_mass: numbers,
             pinned: ti.types.ndarray(dtype=ti.i32, ndim=1), gravity: ti.math.vec3, kept: ti.f32, dt: ti.f32):
    for i in x:
        if pinned[i] == 0:
            force = load[i]
            for b in range(26):
                j = neighbours[b, i]
                if j >= 0:
                    d = x[i] - x[j]
                    length = ti.math.length(d)
                    force += stiffness[b, i] * (lengths[b] - length) / length * d
            v[i] = kept * v[i] + dt * (force * inverse_mass[i] + gravity)
            x_new[i] = x[i] + dt * v[i]


def peer(body, device):
    ti.init(arch=ti.cuda if device == "cuda" else ti.cpu, fast_math=False, log_level=ti.ERROR, offline_cache=False)

    def array(values, dtype):
        made = ti.ndarray(dtype=dtype, shape=values.shape)
        made.from_numpy(np.ascontiguousarray(values))
        return made

    def vector_array(values):
        made = ti.ndarray(dtype=ti.math.vec3, shape=len(values))
        made.from_numpy(values.astype(np.float32))
        return made

    data = (array(body.neighbours.T, ti.i32), array(body.neighbour_stiffness.T.astype(np.float32), ti.f32),
            array(body.direction_length.astype(np.float32), ti.f32), vector_array(body.load),
            array((1 / body.mass).astype(np.float32), ti.f32), array(body.pinned.astype(np.int32), ti.i32),
            ti.math.vec3(*body.gravity), 1 - body.damping, body.time_step)
    x_new = vector_array(body.start)

    def step(x, v, count):
        there = x_new
        there.copy_from(x)
        for _ in range(count):
            one_step(x, v, there, *data)
            x, there = there, x
        return x, v

    return step, f"taichi:{device}"
