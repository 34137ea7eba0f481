// Open MPI, which connects the processes that mpirun starts. The library of Open MPI is opened at run time,
// so that a start without mpirun does not need it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <list>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <vector>

namespace voxspring {

/// Connects this process with the others that mpirun started. Only the thread that called join() may use it.
/// Errors in MPI end all of these processes, which is MPI's default.
class OpenMpi {
public:
    /// The result is null if mpirun did not start this process. Throws BadInput with the reason if mpirun
    /// started it and Open MPI cannot be used.
    static std::unique_ptr<OpenMpi> join();
    OpenMpi() = default;
    OpenMpi(const OpenMpi&) = delete;
    OpenMpi& operator=(const OpenMpi&) = delete;
    /// Waits for all other processes to leave.
    virtual ~OpenMpi() = default;

    virtual int rank() const = 0;
    virtual int ranks() const = 0;

    /// A message that has been sent and not yet received.
    struct Arrived {
        int from;
        std::size_t bytes;
    };
    /// A message with this tag from rank `from`, or from any rank; empty if none has arrived.
    virtual std::optional<Arrived> arrived(int tag, std::optional<int> from = {}) const = 0;
    virtual void receive(int from, int tag, void* to, std::size_t bytes) const = 0;

    /// A message on its way. It is gone as soon as the sender may change its bytes. The destructor waits
    /// until the message is gone, maybe until the other rank receives it: two ranks that wait for each other
    /// in this way deadlock.
    class Sending {
    public:
        Sending() = default;
        Sending(const Sending&) = delete;
        Sending& operator=(const Sending&) = delete;
        virtual ~Sending() = default;
        virtual bool is_gone() = 0;
    };
    /// Starts to send `bytes` bytes, which must not change until the message is gone.
    virtual std::unique_ptr<Sending> start_to_send(int to, int tag, const void* from,
                                                   std::size_t bytes) const = 0;

    /// Starts to send a copy of `message`, and returns at once. So all ranks may send to each other before
    /// any of them receives, however long the messages are.
    void send_json(int to, int tag, const nlohmann::json& message);
    /// Whether all messages of send_json() are gone. MPI moves long messages only within calls of MPI: a rank
    /// that others wait for must call this, and receive messages, until this returns true.
    bool has_sent_all();
    nlohmann::json receive_json(const Arrived& message, int tag) const;

protected:
    /// Waits until all messages of send_json() are gone; for the destructor of the implementation.
    void wait_for_sent() { posted_.clear(); }

private:
    struct Posted {
        std::vector<std::uint8_t> bytes;
        std::unique_ptr<Sending> sending = nullptr;
    };
    std::list<Posted> posted_;
};

}  // namespace voxspring
