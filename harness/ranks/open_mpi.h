// Open MPI, which connects the processes that mpirun starts. Its library is opened at run time: who runs
// without mpirun needs none.
#pragma once

#include <cstddef>
#include <cstdint>
#include <list>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

namespace voxspring {

/// This process among those that mpirun started. Called by one thread at a time. Errors of MPI end all of
/// these processes, which is MPI's own way with them.
class OpenMpi {
public:
    /// Null where mpirun has not started this process. Throws BadInput where it has and there is no Open MPI
    /// to be had, saying why.
    static std::unique_ptr<OpenMpi> join();
    OpenMpi() = default;
    OpenMpi(const OpenMpi&) = delete;
    OpenMpi& operator=(const OpenMpi&) = delete;
    /// Waits for all others to leave.
    virtual ~OpenMpi() = default;

    virtual int rank() const = 0;
    virtual int ranks() const = 0;

    /// A message that somebody sent and nobody has received.
    struct Arrived {
        int from;
        std::size_t bytes;
    };
    /// From any rank, or from that one, if there is any.
    virtual std::optional<Arrived> arrived(int tag, std::optional<int> from = {}) const = 0;
    virtual void receive(int from, int tag, void* to, std::size_t bytes) const = 0;

    /// A message on its way. Its destructor waits until it is gone, and the other rank may have to receive it
    /// before that: of two ranks that both wait so neither receives.
    class Sending {
    public:
        Sending() = default;
        Sending(const Sending&) = delete;
        Sending& operator=(const Sending&) = delete;
        virtual ~Sending() = default;
        virtual bool is_gone() = 0;
    };
    /// What is sent stays as it is until it is gone.
    virtual std::unique_ptr<Sending> start_to_send(int to, int tag, const void* from,
                                                   std::size_t bytes) const = 0;

    /// Returns at once: the message is kept here until it is gone. So all ranks may send to all before any
    /// of them receives, however long the messages are.
    void send_json(int to, int tag, const nlohmann::json& message);
    /// Whether all messages of send_json() are gone. MPI moves long ones only within its own calls: a rank
    /// that others wait for asks this, and receives, until it is so.
    bool has_sent_all();
    nlohmann::json receive_json(const Arrived& message, int tag) const;

protected:
    /// Waits until has_sent_all(); for the destructor of what sends.
    void wait_for_sent() { posted_.clear(); }

private:
    struct Posted {
        std::vector<std::uint8_t> bytes;
        std::unique_ptr<Sending> sending = nullptr;
    };
    std::list<Posted> posted_;
};

}  // namespace voxspring
