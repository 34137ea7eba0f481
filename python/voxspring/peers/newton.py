"""Newton: the system's own springs and semi-implicit solver; only damping is a kernel of this file."""

import newton
import numpy as np
import warp as wp

wp.config.quiet = True


@wp.kernel
def damp(v: wp.array(dtype=wp.vec3), kept: float):
    i = wp.tid()
    v[i] = kept * v[i]


def peer(body, device):
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    for position, mass, pinned in zip(body.start, body.mass, body.pinned):
        builder.add_particle(pos=wp.vec3(*position), vel=wp.vec3(0.0), mass=0.0 if pinned else float(mass))
    for (i, j), k in zip(body.springs.tolist(), body.stiffness.tolist()):
        builder.add_spring(i, j, k, 0.0, 0.0)
    model = builder.finalize(device=device)
    model.spring_rest_length.assign(body.rest_length.astype(np.float32))
    # The model is built without gravity, so the weight is added to the load.
    weight = body.load + np.where(body.pinned, 0, body.mass)[:, None] * np.array(body.gravity)
    load = wp.array(weight, dtype=wp.vec3, device=device)
    solver, states = newton.solvers.SolverSemiImplicit(model), [model.state(), model.state()]
    kept, dt = 1 - body.damping, body.time_step

    def step(x, v, count):
        now, after = states
        wp.copy(now.particle_q, x)
        wp.copy(now.particle_qd, v)
        for _ in range(count):
            now.clear_forces()
            wp.copy(now.particle_f, load)
            wp.launch(damp, dim=len(body), inputs=[now.particle_qd, kept], device=device)
            solver.step(now, after, None, None, dt)
            now, after = after, now
        return now.particle_q, now.particle_qd

    return step, f"warp:{device}", f"newton {newton.__version__}"
