"""PyTorch: a step by operations on whole tensors, compiled by torch.compile."""

import torch


def peer(body, device):
    def tensor(array, dtype=torch.float32):
        return torch.as_tensor(array, dtype=dtype, device=device)

    neighbours = tensor(body.neighbours, torch.int64)
    neighbours = torch.where(neighbours >= 0, neighbours, torch.arange(len(body), device=device)[:, None])
    stiffness, lengths = tensor(body.neighbour_stiffness), tensor(body.direction_length)
    load, gravity = tensor(body.load), tensor(body.gravity)
    inverse_mass, free = tensor(1 / body.mass)[:, None], tensor(~body.pinned)[:, None]
    kept, dt = 1 - body.damping, body.time_step

    @torch.compile
    def one_step(x, v):
        d = x[:, None] - x[neighbours]
        length = d.square().sum(-1).sqrt().clamp(min=1e-6)
        force = load + ((stiffness * (lengths - length) / length)[:, :, None] * d).sum(1)
        v = free * (kept * v + dt * (force * inverse_mass + gravity))
        return x + dt * v, v

    def step(x, v, count):
        for _ in range(count):
            x, v = one_step(x, v)
        return x, v

    return step, f"torch:{device}"
