#include "harness/process/message.h"

#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>
#include <vector>

#include "harness/base/clock.h"
#include "harness/base/json.h"

namespace voxspring {
namespace {

/// Returns once there are bytes to receive or the other end is closed. Throws Late at the deadline.
void wait_for_input(int socket, const Deadline& until) {
    for (;;) {
        int milliseconds = -1;
        if (until) {
            const auto left = std::chrono::ceil<std::chrono::milliseconds>(*until - Clock::now()).count();
            if (left <= 0) throw Late();
            // poll() takes an int. If more milliseconds are left, the loop calls poll() again.
            milliseconds = int(std::min<std::int64_t>(left, 1000000));
        }
        pollfd waiting{socket, POLLIN, 0};
        if (poll(&waiting, 1, milliseconds) > 0) return;
    }
}

/// Aligned room for one file descriptor, which is sent as ancillary data of a message.
union DescriptorRoom {
    cmsghdr aligned;
    char bytes[CMSG_SPACE(sizeof(int))];
};

/// A message that consists of the byte `byte` and a descriptor in `room`.
msghdr descriptor_message(iovec& byte, DescriptorRoom& room) {
    msghdr message{};
    message.msg_iov = &byte;
    message.msg_iovlen = 1;
    message.msg_control = room.bytes;
    message.msg_controllen = sizeof room.bytes;
    return message;
}

}  // namespace

void send_bytes(int socket, const void* bytes, std::size_t count) {
    const auto* from = static_cast<const char*>(bytes);
    while (count > 0) {
        const ssize_t sent = send(socket, from, count, MSG_NOSIGNAL);
        if (sent < 0 && errno == EINTR) continue;
        if (sent <= 0) throw Closed();
        from += sent;
        count -= std::size_t(sent);
    }
}

void receive_bytes(int socket, void* bytes, std::size_t count, const Deadline& until) {
    auto* to = static_cast<char*>(bytes);
    while (count > 0) {
        wait_for_input(socket, until);
        const ssize_t received = recv(socket, to, count, 0);
        if (received < 0 && errno == EINTR) continue;
        if (received <= 0) throw Closed();
        to += received;
        count -= std::size_t(received);
    }
}

/// Messages are CBOR, which unlike JSON text has NaN and infinity. The length is sent before the message.
void send_message(int socket, const nlohmann::json& message) {
    const std::vector<std::uint8_t> bytes = cbor_of(message);
    const std::uint64_t size = bytes.size();
    send_bytes(socket, &size, sizeof size);
    send_bytes(socket, bytes.data(), bytes.size());
}

nlohmann::json receive_message(int socket, const Deadline& until) {
    std::uint64_t size = 0;
    receive_bytes(socket, &size, sizeof size, until);
    std::vector<std::uint8_t> bytes(size);
    receive_bytes(socket, bytes.data(), bytes.size(), until);
    return message_of(bytes);
}

void send_descriptor(int socket, int descriptor) {
    char nothing = 0;
    iovec byte{&nothing, 1};
    DescriptorRoom room{};
    const msghdr message = descriptor_message(byte, room);
    cmsghdr* header = CMSG_FIRSTHDR(&message);
    header->cmsg_level = SOL_SOCKET;
    header->cmsg_type = SCM_RIGHTS;
    header->cmsg_len = CMSG_LEN(sizeof descriptor);
    std::memcpy(CMSG_DATA(header), &descriptor, sizeof descriptor);
    ssize_t sent;
    do {
        sent = sendmsg(socket, &message, MSG_NOSIGNAL);
    } while (sent < 0 && errno == EINTR);
    if (sent <= 0) throw Closed();
}

int receive_descriptor(int socket, const Deadline& until) {
    char nothing = 0;
    iovec byte{&nothing, 1};
    DescriptorRoom room{};
    msghdr message = descriptor_message(byte, room);
    ssize_t received;
    do {
        wait_for_input(socket, until);
        received = recvmsg(socket, &message, MSG_CMSG_CLOEXEC);
    } while (received < 0 && errno == EINTR);
    const cmsghdr* header = received > 0 ? CMSG_FIRSTHDR(&message) : nullptr;
    // The system drops the descriptor if this process already has as many open files as it may have.
    if (header == nullptr || header->cmsg_type != SCM_RIGHTS) throw Closed();
    int descriptor = -1;
    std::memcpy(&descriptor, CMSG_DATA(header), sizeof descriptor);
    return descriptor;
}

}  // namespace voxspring
