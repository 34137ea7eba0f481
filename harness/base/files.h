// Files written so that no reader ever sees half of one.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace voxspring {

/// Replaces `path` by `text` in one step: a reader sees the old file or the new one. Of a symbolic link that
/// is the file behind it; what is no file, a pipe or a device, is written to as it is. Throws
/// std::system_error, leaving `path` as it was.
void write_atomically(const std::filesystem::path& path, const std::string& text);

/// Removes the temporary file of a write_atomically() that is under way: for the handler of a signal that
/// ends the process.
void remove_unfinished_file();

/// Writes all of it to an open file; false, with errno set, if not all of it could be written.
bool write_all(int file, std::string_view text);
/// Makes what was created in, renamed to or removed from a file's folder outlast a loss of power, as far as
/// the file system can.
void sync_folder_of(const std::filesystem::path& file);

/// Throws BadInput unless `path` ends in `extension`, is no folder and lies in one that takes a new file.
/// `option` is what the message calls it.
void check_writable(const std::filesystem::path& path, const std::string& option,
                    const std::string& extension);

}  // namespace voxspring
