#include "cuda/common/particles.h"

namespace voxspring::cuda {
namespace {

bool is_tuned(const Options& options, const std::string& key, const std::string& value) {
    const auto found = options.tuning.find(key);
    return found != options.tuning.end() && found->second == value;
}

}  // namespace

Fetch fetch_path(const std::string& tuned) {
    if (tuned == "cg") return Fetch::past_l1;
    return tuned == "texture" ? Fetch::texture : Fetch::through_l1;
}

KernelFamily::KernelFamily(const Options& options, Fetch path)
    : precision(options.precision),
      formulation(options.formulation),
      fetch(path),
      all_terms(options.tuning.at("terms") == "all"),
      dependent_launch(is_tuned(options, "dependent_launch", "on")),
      may_be_dependent(is_tuned(options, "dependent_launch", "auto")),
      replays(!is_tuned(options, "graph", "off")) {}

KernelFamily KernelFamily::on(const Device& device) const {
    KernelFamily family = *this;
    if (may_be_dependent) family.dependent_launch = device.has_dependent_launches();
    return family;
}

KernelSource KernelFamily::source(const std::string& file, const Problem& problem, int threads, int blocks,
                                  std::uint32_t more_terms) const {
    const std::uint32_t terms = (all_terms ? layout::all_terms : terms_of(problem)) | more_terms;
    const std::uint32_t groups = all_terms ? NEIGHBOUR_BITS : problem.group_bits;
    const char* const paths[] = {"PastL1", "ThroughL1", "ThroughTexture"};
    KernelSource source{
        file,
        {{"REAL", precision == Precision::float32 ? "float" : "double"},
         {"FETCH", paths[std::size_t(fetch)]},
         {"TERMS", "KernelTerms<Formulation::" + to_string(formulation) + "," + std::to_string(groups) +
                       "u," + std::to_string(terms) + "u," + (all_terms ? "true" : "false") + ">"},
         {"THREADS", std::to_string(threads)},
         {"BLOCKS", std::to_string(blocks)}}};
    if (dependent_launch) source.macros["DEPENDENT_LAUNCH"] = "1";
    return source;
}

template <class Real>
std::string too_many_words(std::size_t words, const Device& device, Fetch fetch) {
    if (words > max_words)
        return std::to_string(words) + " words of positions are too many: kernels can index at most " +
               std::to_string(max_words);
    const std::size_t texels = fetch == Fetch::texture ? words * texels_per_word<Real> : 0;
    if (texels > device.max_texels)
        return std::to_string(texels) +
               " texels of positions are too many for fetch=texture: on this device a texture has at most " +
               std::to_string(device.max_texels) + " texels";
    return {};
}

template std::string too_many_words<float>(std::size_t, const Device&, Fetch);
template std::string too_many_words<double>(std::size_t, const Device&, Fetch);

template <class Real>
std::string launch_refusal(std::size_t words, const Device& device, const KernelFamily& family) {
    if (family.dependent_launch && !device.has_dependent_launches())
        return "dependent_launch=on: compute capability " + version_of(device.architecture) +
               " has no dependent launches, which came with 9.0";
    return too_many_words<Real>(words, device, family.fetch);
}
template std::string launch_refusal<float>(std::size_t, const Device&, const KernelFamily&);
template std::string launch_refusal<double>(std::size_t, const Device&, const KernelFamily&);

}  // namespace voxspring::cuda
