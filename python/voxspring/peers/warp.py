"""Warp: a kernel with one thread for each particle; on a card a graph of two launches is replayed."""

import numpy as np
import warp as wp

wp.config.quiet = True


@wp.kernel
def one_step(x: wp.array(dtype=wp.vec3), v: wp.array(dtype=wp.vec3), x_new: wp.array(dtype=wp.vec3),
             neighbours: wp.array2d(dtype=wp.int32), stiffness: wp.array2d(dtype=float), lengths: wp.array(dtype=float),
             load: wp.array(dtype=wp.vec3), inverse_mass: wp.array(dtype=float), pinned: wp.array(dtype=wp.bool), gravity: wp.vec3,
             kept: float, dt: float):
    i = wp.tid()
    if not pinned[i]:
        force = load[i]
        for b in range(26):
            j = neighbours[b, i]
            if j >= 0:
                d = x[i] - x[j]
                length = wp.length(d)
                force += stiffness[b, i] * (lengths[b] - length) / length * d
        v[i] = kept * v[i] + dt * (force * inverse_mass[i] + gravity)
        x_new[i] = x[i] + dt * v[i]


def peer(body, device):
    with wp.ScopedDevice(device):
        data = [wp.array(np.ascontiguousarray(body.neighbours.T)), wp.array(body.neighbour_stiffness.T.astype(np.float32)),
                wp.array(body.direction_length, dtype=float), wp.array(body.load, dtype=wp.vec3),
                wp.array(1 / body.mass, dtype=float), wp.array(body.pinned, dtype=wp.bool), wp.vec3(*body.gravity),
                1 - body.damping, body.time_step]

    def launch(x, v, x_new):
        wp.launch(one_step, dim=len(body), inputs=[x, v, x_new, *data], device=device)

    def step(x, v, count):
        x_new = wp.clone(x)
        graph = None
        if x.device.is_cuda and count > 3:
            with wp.ScopedCapture(device) as capture:
                launch(x, v, x_new)
                launch(x_new, v, x)
            graph = capture.graph
        for _ in range(count // 2):
            if graph:
                wp.capture_launch(graph)
            else:
                launch(x, v, x_new)
                launch(x_new, v, x)
        if count % 2:
            launch(x, v, x_new)
            x = x_new
        return x, v

    return step, f"warp:{device}"
