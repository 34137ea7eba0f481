"""CuPy: a kernel in CUDA C++."""

import cupy
import numpy as np

import voxspring

KERNEL = cupy.RawKernel(r"""
extern "C" __global__ void one_step(const float3* x, float3* v, float3* x_new, const int* neighbours, const float* stiffness,
                                    const float* lengths, const float3* load, const float* inverse_mass, const bool* pinned,
                                    float gx, float gy, float gz, float kept, float dt, int n) {
    const int i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= n || pinned[i]) return;
    const float3 here = x[i];
    float3 f = load[i];
    for (int b = 0; b < 26; ++b) {
        const int j = neighbours[b * n + i];
        if (j < 0) continue;
        const float3 there = x[j];
        const float dx = here.x - there.x, dy = here.y - there.y, dz = here.z - there.z;
        const float length = sqrtf(dx * dx + dy * dy + dz * dz);
        const float density = stiffness[b * n + i] * (lengths[b] - length) / length;
        f.x += density * dx;
        f.y += density * dy;
        f.z += density * dz;
    }
    float3 w = v[i];
    w.x = kept * w.x + dt * (f.x * inverse_mass[i] + gx);
    w.y = kept * w.y + dt * (f.y * inverse_mass[i] + gy);
    w.z = kept * w.z + dt * (f.z * inverse_mass[i] + gz);
    v[i] = w;
    x_new[i] = make_float3(here.x + dt * w.x, here.y + dt * w.y, here.z + dt * w.z);
}""", "one_step")


def peer(body, device):
    if device != "cuda":
        raise voxspring.Unavailable("CuPy computes on a card only")
    n, block = len(body), 128

    def column_first(array, dtype):
        return cupy.asarray(np.ascontiguousarray(array.T, dtype=dtype))

    data = (column_first(body.neighbours, np.int32), column_first(body.neighbour_stiffness, np.float32),
            cupy.asarray(body.direction_length, dtype=np.float32), cupy.asarray(body.load, dtype=np.float32),
            cupy.asarray(1 / body.mass, dtype=np.float32), cupy.asarray(body.pinned), *np.float32(body.gravity),
            np.float32(1 - body.damping), np.float32(body.time_step), np.int32(n))

    def step(x, v, count):
        x_new = x.copy()
        for _ in range(count):
            KERNEL(((n + block - 1) // block,), (block,), (x, v, x_new, *data))
            x, x_new = x_new, x
        return x, v

    return step, "cupy:cuda"
