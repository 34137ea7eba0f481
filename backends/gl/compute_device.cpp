#include "backends/gl/compute_device.h"

#include <array>
#include <chrono>
#include <string>
#include <utility>

#include "backends/gl/feed_pass.h"
#include "backends/gl/program.h"
#include "backends/gl/step_queue.h"
#include "backends/gl/storage_buffer.h"
#include "backends/gl/texture.h"
#include "backends/glsl/compute.h"

namespace voxspring::gl {
namespace {

class GlArray final : public glsl::Array {
public:
    explicit GlArray(StorageBuffer values) : Array(values.bytes()), buffer(std::move(values)) {}
    StorageBuffer buffer;
};

using Bindings = std::array<GLuint, glsl::storage_blocks>;

class GlPass final : public glsl::Pass {
public:
    std::shared_ptr<const Program> program;
    Bindings buffers{};               ///< 0: the shader has no use for this binding
    std::array<Texture, 2> textures;  ///< for fetch=texture: through them the shader reads two of `buffers`
};

class ComputeDevice final : public glsl::Device {
public:
    explicit ComputeDevice(const Options& options)
        : through_textures_(options.tuning.at("fetch") == "texture"),
          barrier_(GL_SHADER_STORAGE_BARRIER_BIT | (through_textures_ ? GL_TEXTURE_FETCH_BARRIER_BIT : 0U)),
          capabilities_(context_.capabilities()),
          limits_{.max_bytes = std::uint64_t(context_.max_storage_block_size()),
                  .limit = "GL_MAX_SHADER_STORAGE_BLOCK_SIZE"},
          queue_(context_),
          begin_(make_query(context_)),
          end_(make_query(context_)) {
        capabilities_.api = "OpenGL compute 4.5 core";
        capabilities_.limits_of = "OpenGL compute";
        GLint max_blocks = 0;
        glGetIntegerv(GL_MAX_COMPUTE_SHADER_STORAGE_BLOCKS, &max_blocks);
        if (max_blocks < glsl::storage_blocks)
            throw Unavailable("a compute shader may have at most " + std::to_string(max_blocks) +
                              " storage buffers, and the number needed is " +
                              std::to_string(glsl::storage_blocks));
    }

    const Capabilities& capabilities() const override { return capabilities_; }
    /// The limits on invocations and extents are those that every driver of OpenGL 4.5 allows.
    glsl::WorkGroupLimits work_group_limits() const override {
        return {1024, {1024, 1024, 64}, std::size_t(context_.max_shared_memory())};
    }
    const glsl::BufferLimits& buffer_limits() const override { return limits_; }
    std::optional<std::uint64_t> free_memory_bytes() const override { return context_.free_memory_bytes(); }
    bool can_vote() const override { return context_.has_subgroup_vote(); }
    std::string refused_words(std::size_t words) const override {
        const auto texels = std::size_t(context_.max_texture_buffer_size());
        if (!through_textures_ || words <= texels) return {};
        return std::to_string(words) + " texels of positions exceed the " + std::to_string(texels) +
               " that the driver allows one texture buffer (fetch=texture)";
    }

    void use(const char*, const std::function<void()>& work) const override {
        context_.make_current();
        work();
    }
    void check(const char* doing) const override { context_.check(doing); }
    void wait() override { glFinish(); }

    std::unique_ptr<glsl::Array> make(std::span<const std::byte> values) override {
        StorageBuffer buffer;
        buffer.replace(context_, values);
        forget_bindings();
        return std::make_unique<GlArray>(std::move(buffer));
    }
    std::unique_ptr<glsl::Array> make_zeros(std::size_t bytes) override {
        StorageBuffer buffer;
        buffer.allocate(context_, bytes);
        glClearNamedBufferData(buffer.get(), GL_R32UI, GL_RED_INTEGER, GL_UNSIGNED_INT, nullptr);
        forget_bindings();
        return std::make_unique<GlArray>(std::move(buffer));
    }
    void overwrite(glsl::Array& array, std::span<const std::byte> values) override {
        buffer_of(array).upload(context_, values);
    }
    void download(const glsl::Array& array, std::span<std::byte> values) override {
        buffer_of(array).download(values);
    }
    std::unique_ptr<glsl::Array> copy_of(const glsl::Array& array) override {
        StorageBuffer buffer;
        buffer.copy(context_, buffer_of(array));
        forget_bindings();
        return std::make_unique<GlArray>(std::move(buffer));
    }
    void copy(const glsl::Array& from, glsl::Array& to) override {
        // The first barrier makes what shaders wrote visible to the copy, the second one makes the copy
        // visible to shaders.
        glMemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
        buffer_of(to).copy(context_, buffer_of(from));
        glMemoryBarrier(barrier_);
    }

    std::shared_ptr<glsl::Pass> pass(const glsl::Shader& shader, const glsl::Uniforms& uniforms,
                                     const glsl::Arrays& arrays) override {
        auto pass = std::make_shared<GlPass>();
        pass->program = program(shader);
        pass->program->set(uniforms);
        for (const auto& [binding, array] : arrays) {
            if (array != nullptr) pass->buffers.at(binding) = buffer_of(*array).get();
        }
        for (std::size_t n = 0; fetches_texels(shader) && n < pass->textures.size(); ++n) {
            const GLuint words = pass->buffers[n == 0 ? glsl::words : glsl::words_low];
            if (words != 0) pass->textures[n] = make_buffer_texture(context_, rgba32f, words);
        }
        return pass;
    }
    void set(glsl::Pass& pass, const glsl::Uniforms& uniforms) override {
        static_cast<GlPass&>(pass).program->set(uniforms);
    }
    void dispatch_once(const glsl::Shader& shader, std::size_t count, const glsl::Uniforms& uniforms,
                       const glsl::Arrays& arrays,
                       const std::map<unsigned, std::span<const std::byte>>& sent) override {
        const auto once = pass(shader, uniforms, arrays);
        // OpenGL keeps these buffers until the dispatch has run, even if they are destroyed before.
        std::array<StorageBuffer, 4> handed_over;
        for (auto next = handed_over.begin(); const auto& [binding, values] : sent) {
            next->replace(context_, values);
            static_cast<GlPass&>(*once).buffers.at(binding) = (next++)->get();
        }
        forget_bindings();
        run({once, {glsl::striding_groups(count), 1, 1}});
        forget_bindings();
    }

    bool records_checks() const override { return false; }
    void step_by(glsl::Dispatches step) override { step_ = std::move(step); }
    void step(int count) override {
        for (int n = 0; n < count; ++n) {
            for (const glsl::Dispatch& dispatch : step_[current()]) run(dispatch);
            count_steps(1);
            queue_.enqueued();
            if (!is_check_due()) continue;
            for (const glsl::Dispatch& dispatch : check_[current()]) {
                const auto& pass = static_cast<const GlPass&>(*dispatch.pass);
                pass.program->set("check_number", int(steps() / check_every()));
                run(dispatch);
            }
        }
    }
    std::optional<std::uint64_t> step_counted() override {
        if (!context_.has_pipeline_statistics()) {
            step(1);
            return std::nullopt;
        }
        const Query query = make_query(context_);
        glBeginQuery(GL_COMPUTE_SHADER_INVOCATIONS_ARB, query.get());
        step(1);
        glEndQuery(GL_COMPUTE_SHADER_INVOCATIONS_ARB);
        return result_of(query);
    }

    void mark(bool at_end) override { glQueryCounter((at_end ? end_ : begin_).get(), GL_TIMESTAMP); }
    double seconds_between_marks() const override {
        const GLuint64 begin = result_of(begin_);
        return 1e-9 * double(result_of(end_) - begin);
    }
    double seconds_of(const std::vector<glsl::Dispatch>& cycle, int count) override {
        glFinish();
        const auto begin = std::chrono::steady_clock::now();
        for (std::size_t n = 0; n < std::size_t(count); ++n) run(cycle[n % cycle.size()]);
        glFinish();
        return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    }
    bool has_float64() const override { return false; }
    bool launches_differ() const override { return true; }

    bool has_feeds() const override { return true; }
    std::unique_ptr<Feed> feed(const std::vector<layout::FedWord<float>>& fed, std::uint32_t buffer,
                               const Defines& macros, const std::array<glsl::Arrays, 2>& state) override {
        if (!context_.shares()) return nullptr;
        const auto made = program({.file = "feed", .macros = macros});
        return std::make_unique<FeedPass>(context_, fed, buffer, *made, [this, made, state] {
            for (const auto& [binding, array] : state[current()]) {
                if (array != nullptr) buffer_of(*array).bind(binding);
            }
            forget_bindings();
        });
    }

private:
    void check_by(glsl::Dispatches check) override { check_ = std::move(check); }

    static StorageBuffer& buffer_of(glsl::Array& array) { return static_cast<GlArray&>(array).buffer; }
    static const StorageBuffer& buffer_of(const glsl::Array& array) {
        return static_cast<const GlArray&>(array).buffer;
    }
    static GLuint64 result_of(const Query& query) {
        GLuint64 result = 0;
        glGetQueryObjectui64v(query.get(), GL_QUERY_RESULT, &result);
        return result;
    }

    /// Only the shader of a step fetches texels. It is the only shader whose source does not fix the extents
    /// of its work groups (Shader::group).
    bool fetches_texels(const glsl::Shader& shader) const { return through_textures_ && shader.group; }

    Defines defines_of(const glsl::Shader& shader) const {
        Defines defines = {{"COMPUTE", ""}, {"STORAGE_BUFFERS", ""}};
        for (const Defines& some : {shader.macros, shader.constants})
            defines.insert(some.begin(), some.end());
        if (const auto vote = defines.find("VOTE"); vote != defines.end() && vote->second == "true")
            defines["SUBGROUPS"] = "";
        if (fetches_texels(shader)) defines["TEXTURE"] = "";
        if (const auto group = shader.group) {
            defines["BLOCK"] = defines["BLOCK_X"] = std::to_string(group->x);
            defines["BLOCK_Y"] = std::to_string(group->y);
            defines["BLOCK_Z"] = std::to_string(group->z);
        }
        return defines;
    }
    std::shared_ptr<const Program> program(const glsl::Shader& shader) {
        const Defines defines = defines_of(shader);
        std::string key = shader.file;
        for (const auto& [name, value] : defines) key += " " + name + "=" + value;
        std::shared_ptr<const Program>& made = programs_.of(key);
        if (made) return made;
        const auto begin = std::chrono::steady_clock::now();
        made = std::make_shared<const Program>(context_, load_source(shader.file + ".comp", defines));
        const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
        // Whether the driver found the program in its disk cache is not known, so `spent` and `cold` are the
        // same.
        compile_time_ += {seconds.count(), seconds.count()};
        return made;
    }

    /// Binds what `pass` uses. Skips buffers that are bound already, and binds the others with one call per
    /// run of consecutive bindings.
    void bind(const GlPass& pass) {
        const auto is_new = [&](std::size_t n) {
            return n < bound_.size() && pass.buffers[n] != 0 && pass.buffers[n] != bound_[n];
        };
        for (std::size_t n = 0; n < bound_.size(); ++n) {
            const std::size_t first = n;
            for (; is_new(n); ++n) bound_[n] = pass.buffers[n];
            if (n > first)
                glBindBuffersBase(GL_SHADER_STORAGE_BUFFER, GLuint(first), GLsizei(n - first),
                                  &bound_[first]);
        }
        if (pass.textures[0].get() != 0) {
            const std::array textures = {pass.textures[0].get(), pass.textures[1].get()};
            glBindTextures(0, GLsizei(textures.size()), textures.data());
        }
        if (const GLuint program = pass.program->get(); program != std::exchange(in_use_, program))
            glUseProgram(program);
    }
    /// Makes the next bind() bind everything. To be called after other code bound buffers, or after buffers
    /// were made: a new buffer may have the name of an old one.
    void forget_bindings() {
        bound_ = {};
        in_use_ = 0;
    }
    void run(const glsl::Dispatch& dispatch) {
        bind(static_cast<const GlPass&>(*dispatch.pass));
        glDispatchCompute(dispatch.groups.x, dispatch.groups.y, dispatch.groups.z);
        glMemoryBarrier(barrier_);
    }
    Context context_;
    const bool through_textures_;
    const GLbitfield barrier_;
    Capabilities capabilities_;
    const glsl::BufferLimits limits_;
    StepQueue queue_;
    Query begin_, end_;
    glsl::ProgramCache<Program> programs_;
    glsl::Dispatches step_, check_;
    Bindings bound_{};
    GLuint in_use_ = 0;
};

}  // namespace

std::unique_ptr<glsl::Device> make_compute_device(const Options& options) {
    return std::make_unique<ComputeDevice>(options);
}

}  // namespace voxspring::gl
