// Versions of the files that results/*.schema.json describe. A version is raised with its schema if an older
// reader would misread a newer file; results/README.md says when.
#pragma once

namespace voxspring {

inline constexpr int scene_schema_version = 1;
inline constexpr int study_schema_version = 1;
inline constexpr int result_schema_version = 1;

}  // namespace voxspring
