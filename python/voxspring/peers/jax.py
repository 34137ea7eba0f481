"""JAX: steps by operations on whole arrays; the loop over steps is compiled as one function."""

import os

os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")

import jax
import jax.numpy as jnp


def peer(body, device):
    neighbours = jnp.asarray(body.neighbours)
    neighbours = jnp.where(neighbours >= 0, neighbours, jnp.arange(len(body))[:, None])
    stiffness, lengths = jnp.float32(body.neighbour_stiffness), jnp.float32(body.direction_length)
    load, gravity = jnp.float32(body.load), jnp.float32(body.gravity)
    inverse_mass, free = jnp.float32(1 / body.mass)[:, None], ~jnp.asarray(body.pinned)[:, None]
    kept, dt = jnp.float32(1 - body.damping), jnp.float32(body.time_step)

    def one_step(_, state):
        x, v = state
        d = x[:, None] - x[neighbours]
        length = jnp.maximum(jnp.sqrt((d * d).sum(-1)), 1e-6)
        force = load + ((stiffness * (lengths - length) / length)[:, :, None] * d).sum(1)
        v = free * (kept * v + dt * (force * inverse_mass + gravity))
        return x + dt * v, v

    @jax.jit
    def step(x, v, count):
        return jax.lax.fori_loop(0, count, one_step, (x, v))

    return step, f"jax:{device}"
