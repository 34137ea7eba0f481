// Linear device memory as a texture of 16-byte texels, fetched by index through the texture path.
#pragma once

#include "cuda/device/buffer.h"

namespace voxspring::cuda {

using Texture = Handle<cudaTextureObject_t, cudaDestroyTextureObject>;

/// Texels are float4 or, if `kind` is cudaChannelFormatKindSigned, int4. Indices past the end give zeros.
template <class T>
Texture make_texture(const Buffer<T>& buffer, cudaChannelFormatKind kind) {
    cudaResourceDesc resource{};
    resource.resType = cudaResourceTypeLinear;
    resource.res.linear.devPtr = buffer.data();
    resource.res.linear.desc = cudaCreateChannelDesc(32, 32, 32, 32, kind);
    resource.res.linear.sizeInBytes = buffer.bytes();
    cudaTextureDesc description{};
    description.readMode = cudaReadModeElementType;
    cudaTextureObject_t texture{};
    check(cudaCreateTextureObject(&texture, &resource, &description, nullptr));
    return Texture(texture);
}

}  // namespace voxspring::cuda
