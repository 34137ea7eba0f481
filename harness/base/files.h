// Writes files so that no reader ever sees half of one, and identifies the program by its file.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace voxspring {

/// Replaces `path` by `text` in one step: a reader sees the old file or the new one. If `path` is a symbolic
/// link, the file behind it is replaced. A pipe or a device is written in place. If writing fails, throws
/// std::system_error and leaves a file at `path` as it was.
void write_atomically(const std::filesystem::path& path, const std::string& text);

/// Removes the temporary file of a write_atomically() that is under way: for the handler of a signal that
/// ends the process.
void remove_unfinished_file();

/// Writes all of `text` to an open file. Returns false, with errno set, if not all of it could be written.
bool write_all(int file, std::string_view text);
/// Flushes the folder of `file`: files created, renamed or removed there then survive a loss of power, as far
/// as the file system can ensure it.
void sync_folder_of(const std::filesystem::path& file);

/// Throws BadInput unless `path` ends in `extension` and can be written: a pipe, a device, or a file (no
/// folder) in a folder where files can be created. `option` is the name of the argument in the message.
void check_writable(const std::filesystem::path& path, const std::string& option,
                    const std::string& extension);

/// The hash of the executable's file. Unlike the commit's hash, it also changes with the compiler, the flags
/// and code that is not committed. The file is read once per process.
const std::string& fingerprint_of_executable();

}  // namespace voxspring
