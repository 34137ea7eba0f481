// Sends a scene from one process of this program to another, and receives it there.
#include <sys/uio.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <type_traits>

#include "backends/physics/huge_pages.h"
#include "harness/process/message.h"

namespace voxspring {
namespace {

/// Arrays of at least this many bytes are written directly into the receiver's memory, by all threads, in
/// pieces of this size.
constexpr std::size_t large = std::size_t(1) << 22;

/// Copies `count` bytes to `address` in the memory of another process. Returns false if the copy failed, and
/// may then have written some of the bytes.
bool write_into(pid_t process, std::uint64_t address, const void* from, std::size_t count) {
    std::atomic<bool> written = true;
#pragma omp parallel for schedule(dynamic)
    for (std::ptrdiff_t n = 0; n < std::ptrdiff_t((count + large - 1) / large); ++n) {
        std::size_t at = std::size_t(n) * large;
        const std::size_t end = std::min(count, at + large);
        while (at < end && written) {
            const iovec here{const_cast<char*>(static_cast<const char*>(from)) + at, end - at};
            const iovec there{std::bit_cast<void*>(address + at), end - at};
            const ssize_t some = process_vm_writev(process, &here, 1, &there, 1, 0);
            if (some <= 0) written = false;
            at += std::size_t(std::max<ssize_t>(some, 0));
        }
    }
    return written;
}

struct Sender {
    int socket;
    pid_t receiver;
    void bytes(const void* from, std::size_t count) const {
        if (count >= large) {
            const nlohmann::json address = receive_message(socket);
            if (address.is_object()) throw std::runtime_error(address.at("error").get<std::string>());
            const bool written = write_into(receiver, address, from, count);
            send_bytes(socket, &written, sizeof written);
            if (written) return;
        }
        send_bytes(socket, from, count);
    }
    template <class Sequence>
    void size(const Sequence& sequence) const {
        const std::uint64_t count = sequence.size();
        bytes(&count, sizeof count);
    }
};

struct Receiver {
    int socket;
    void bytes(void* to, std::size_t count) const {
        if (count >= large) {
            send_message(socket, std::bit_cast<std::uint64_t>(to));
            bool written = false;
            receive_bytes(socket, &written, sizeof written);
            if (written) return;
        }
        receive_bytes(socket, to, count);
    }
    template <class Sequence>
    void size(Sequence& sequence) const {
        std::uint64_t count = 0;
        bytes(&count, sizeof count);
        if constexpr (std::is_same_v<Sequence, std::string>) {
            sequence.resize(count);
        } else {
            // The launcher, which receives scenes, must not have further threads (launcher.h).
            reserve_in_huge_pages(sequence, count);
            sequence.resize(count);
        }
    }
};

template <class Stream, class Value>
void pass(const Stream& stream, Value& value);

template <class Stream, class... Values>
void pass_all(const Stream& stream, Values&... values) {
    (pass(stream, values), ...);
}

/// Passes the members of a structure that cannot be copied as plain bytes. Each structure is unpacked by a
/// structured binding of all members. So if a structure gets a new member, this does not compile until the
/// member is added here.
template <class Stream, class Value>
void pass_members(const Stream& stream, Value& value) {
    using Plain = std::remove_const_t<Value>;
    if constexpr (std::is_same_v<Plain, Scene>) {
        // Volume, mesh, world and damping per second are not passed, since no worker uses them.
        auto& [name, source, description, problem, state, edits, tool_motion, stable_time_step, volume, mesh,
               notes, world, damping_per_second] = value;
        pass_all(stream, name, source, description, problem, state, edits, tool_motion, stable_time_step,
                 notes);
    } else if constexpr (std::is_same_v<Plain, Problem>) {
        auto& [rest_position, materials, material, pinned, ghosts, load, tool, lattice, rest_length,
               group_stiffness, group_bits, springs, gravity, damping, time_step] = value;
        pass_all(stream, rest_position, materials, material, pinned, ghosts, load, tool, lattice, rest_length,
                 group_stiffness, group_bits, springs, gravity, damping, time_step);
    } else if constexpr (std::is_same_v<Plain, Tool>) {
        auto& [particles, held, stiffness] = value;
        pass_all(stream, particles, held, stiffness);
    } else if constexpr (std::is_same_v<Plain, ToolMotion>) {
        auto& [every, time, displacement] = value;
        pass_all(stream, every, time, displacement);
    } else if constexpr (std::is_same_v<Plain, Lattice>) {
        auto& [dims, spacing, voxel, mask] = value;
        pass_all(stream, dims, spacing, voxel, mask);
    } else if constexpr (std::is_same_v<Plain, State>) {
        auto& [displacement, increment] = value;
        pass_all(stream, displacement, increment);
    } else if constexpr (std::is_same_v<Plain, ScheduledEdit>) {
        auto& [step, edit] = value;
        pass_all(stream, step, edit);
    } else if constexpr (std::is_same_v<Plain, SpringDifference>) {
        auto& [removed, added] = value;
        pass_all(stream, removed, added);
    } else {
        static_assert(std::is_same_v<Plain, SpringDifference::Springs>);
        auto& [on_lattice, beyond] = value;
        pass_all(stream, on_lattice, beyond);
    }
}

template <class Value>
concept Sequence = requires(Value value) {
    value.data();
    value.size();
    typename Value::allocator_type;
};

template <class Stream, class Value>
void pass(const Stream& stream, Value& value) {
    if constexpr (Sequence<Value>) {
        stream.size(value);
        if constexpr (std::is_trivially_copyable_v<typename Value::value_type>) {
            stream.bytes(value.data(), value.size() * sizeof(typename Value::value_type));
        } else {
            for (auto& element : value) pass(stream, element);
        }
    } else if constexpr (std::is_trivially_copyable_v<Value>) {
        static_assert(!std::is_pointer_v<Value>);
        stream.bytes(&value, sizeof value);
    } else {
        pass_members(stream, value);
    }
}

}  // namespace

void send_scene(int socket, const Scene* scene, pid_t receiver) {
    const bool there = scene != nullptr;
    const Sender sender{socket, receiver};
    pass(sender, there);
    if (there) pass(sender, *scene);
}

std::optional<Scene> receive_scene(int socket) {
    bool there = false;
    pass(Receiver{socket}, there);
    if (!there) return std::nullopt;
    Scene scene;
    pass(Receiver{socket}, scene);
    return scene;
}

}  // namespace voxspring
