"""Numba: a parallel loop over particles."""

import numba
import numpy as np

import voxspring


@numba.njit(parallel=True)
def one_step(x, v, x_new, neighbours, stiffness, lengths, load, inverse_mass, pinned, gravity, kept, dt):
    for i in numba.prange(len(x)):
        if pinned[i]:
            continue
        fx, fy, fz = load[i]
        for b in range(26):
            j = neighbours[i, b]
            if j >= 0:
                dx, dy, dz = x[i, 0] - x[j, 0], x[i, 1] - x[j, 1], x[i, 2] - x[j, 2]
                length = np.sqrt(dx * dx + dy * dy + dz * dz)
                density = stiffness[i, b] * (lengths[b] - length) / length
                fx += density * dx
                fy += density * dy
                fz += density * dz
        v[i, 0] = kept * v[i, 0] + dt * (fx * inverse_mass[i] + gravity[0])
        v[i, 1] = kept * v[i, 1] + dt * (fy * inverse_mass[i] + gravity[1])
        v[i, 2] = kept * v[i, 2] + dt * (fz * inverse_mass[i] + gravity[2])
        for axis in range(3):
            x_new[i, axis] = x[i, axis] + dt * v[i, axis]


def peer(body, device):
    data = (body.neighbours, body.neighbour_stiffness.astype(np.float32), body.direction_length.astype(np.float32),
            body.load.astype(np.float32), (1 / body.mass).astype(np.float32), body.pinned, np.float32(body.gravity),
            np.float32(1 - body.damping), np.float32(body.time_step))

    def step(x, v, count):
        x_new = x.copy()
        for _ in range(count):
            one_step(x, v, x_new, *data)
            x, x_new = x_new, x
        return x, v

    return step, voxspring.Arrays(api=f"numba {numba.__version__}")
