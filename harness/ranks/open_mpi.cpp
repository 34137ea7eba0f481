#include "harness/ranks/open_mpi.h"

#include <cstdint>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "harness/base/bad_input.h"
#include "harness/base/json.h"
#include "open_mpi_found.h"  // generated

#ifdef VOXSPRING_HAS_MPI
#include <dlfcn.h>
#define OMPI_SKIP_MPICXX 1
#include <mpi.h>
#endif

namespace voxspring {
namespace {

[[noreturn]] void refuse_mpirun(const std::string& reason) {
    throw BadInput("command line", "mpirun", reason,
                   "Open MPI (Debian's packages: libopenmpi-dev to build Voxspring, openmpi-bin to run it), "
                   "or a start without mpirun");
}

#ifdef VOXSPRING_HAS_MPI

/// The functions and objects of MPI that are used. They are looked up at run time, since the library is not
/// linked.
class Library {
    /// A symbol, which becomes a pointer of the type that it is assigned to.
    struct Symbol {
        void* found;
        template <class Pointer>
        operator Pointer() const {
            return reinterpret_cast<Pointer>(found);
        }
    };
    Symbol find(const char* name) const {
        void* const found = dlsym(handle_, name);
        if (found == nullptr) refuse_mpirun(std::string("libmpi.so.40 has no ") + name);
        return {found};
    }
    static void* opened() {
        // RTLD_GLOBAL makes the library's symbols visible to its plugins, which need them.
        void* const handle = dlopen("libmpi.so.40", RTLD_NOW | RTLD_GLOBAL);
        if (handle == nullptr) refuse_mpirun(dlerror());
        return handle;
    }
    void* const handle_ = opened();

public:
    const MPI_Comm world = find("ompi_mpi_comm_world");
    const MPI_Datatype byte = find("ompi_mpi_byte");
    decltype(&MPI_Init_thread) const init_thread = find("MPI_Init_thread");
    decltype(&MPI_Finalize) const finalize = find("MPI_Finalize");
    decltype(&MPI_Comm_rank) const comm_rank = find("MPI_Comm_rank");
    decltype(&MPI_Comm_size) const comm_size = find("MPI_Comm_size");
    decltype(&MPI_Iprobe) const iprobe = find("MPI_Iprobe");
    decltype(&MPI_Get_count) const get_count = find("MPI_Get_count");
    decltype(&MPI_Recv) const recv = find("MPI_Recv");
    decltype(&MPI_Isend) const isend = find("MPI_Isend");
    decltype(&MPI_Test) const test = find("MPI_Test");
    decltype(&MPI_Wait) const wait = find("MPI_Wait");
};

class SendingByMpi final : public OpenMpi::Sending {
public:
    SendingByMpi(const Library& library, int to, int tag, const void* from, std::size_t bytes)
        : library_(library) {
        library.isend(from, int(bytes), library.byte, to, tag, library.world, &request_);
    }
    ~SendingByMpi() override {
        if (!gone_) library_.wait(&request_, MPI_STATUS_IGNORE);
    }
    bool is_gone() override {
        int gone = 0;
        if (!gone_) library_.test(&request_, &gone, MPI_STATUS_IGNORE);
        gone_ = gone_ || gone != 0;
        return gone_;
    }

private:
    const Library& library_;
    MPI_Request request_ = nullptr;
    bool gone_ = false;
};

class LoadedOpenMpi final : public OpenMpi {
public:
    LoadedOpenMpi() {
        int provided = 0;
        library_.init_thread(nullptr, nullptr, MPI_THREAD_FUNNELED, &provided);
        if (provided < MPI_THREAD_FUNNELED)
            refuse_mpirun("this Open MPI does not support programs with threads");
        library_.comm_rank(library_.world, &rank_);
        library_.comm_size(library_.world, &ranks_);
    }
    ~LoadedOpenMpi() override {
        wait_for_sent();
        library_.finalize();
    }

    int rank() const override { return rank_; }
    int ranks() const override { return ranks_; }

    std::optional<Arrived> arrived(int tag, std::optional<int> from) const override {
        int is_there = 0, bytes = 0;
        MPI_Status status{};
        library_.iprobe(from.value_or(MPI_ANY_SOURCE), tag, library_.world, &is_there, &status);
        if (is_there == 0) return std::nullopt;
        library_.get_count(&status, library_.byte, &bytes);
        return Arrived{status.MPI_SOURCE, std::size_t(bytes)};
    }
    void receive(int from, int tag, void* to, std::size_t bytes) const override {
        library_.recv(to, int(bytes), library_.byte, from, tag, library_.world, MPI_STATUS_IGNORE);
    }
    std::unique_ptr<Sending> start_to_send(int to, int tag, const void* from,
                                           std::size_t bytes) const override {
        return std::make_unique<SendingByMpi>(library_, to, tag, from, bytes);
    }

private:
    const Library library_;
    int rank_ = 0, ranks_ = 1;
};

#endif

}  // namespace

std::unique_ptr<OpenMpi> OpenMpi::join() {
    // mpirun sets this variable for every process that it starts.
    if (std::getenv("OMPI_COMM_WORLD_SIZE") == nullptr) return nullptr;
#ifdef VOXSPRING_HAS_MPI
    return std::make_unique<LoadedOpenMpi>();
#else
    refuse_mpirun(std::string("this build has no MPI: ") + no_mpi);
#endif
}

void OpenMpi::send_json(int to, int tag, const nlohmann::json& message) {
    Posted& posted = posted_.emplace_back(Posted{cbor_of(message)});
    posted.sending = start_to_send(to, tag, posted.bytes.data(), posted.bytes.size());
}

bool OpenMpi::has_sent_all() {
    std::erase_if(posted_, [](const Posted& posted) { return posted.sending->is_gone(); });
    return posted_.empty();
}

nlohmann::json OpenMpi::receive_json(const Arrived& message, int tag) const {
    std::vector<std::uint8_t> bytes(message.bytes);
    receive(message.from, tag, bytes.data(), bytes.size());
    return message_of(bytes);
}

}  // namespace voxspring
