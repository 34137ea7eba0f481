// Writes files such that no reader sees an incomplete one, and identifies the program by a hash of its file.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace voxspring {

/// Replaces `path` by `text` in one step: a reader sees the old file or the new one. If `path` is a symbolic
/// link, the file that the link leads to is replaced. A pipe or a device is written in place. If writing
/// fails, throws std::system_error and leaves the old file as it was.
void write_atomically(const std::filesystem::path& path, const std::string& text);

/// Removes the temporary file that write_atomically() is writing, if there is one. The handler of a signal
/// that ends the process calls this.
void remove_unfinished_file();

/// Writes all of `text` to an open file. Returns false, with errno set, if not all of it could be written.
bool write_all(int file, std::string_view text);
/// Syncs the folder of `file` to the disk. Files that were created, renamed or removed in the folder are then
/// still so after a loss of power, as far as the file system can ensure that.
void sync_folder_of(const std::filesystem::path& file);

/// Occupies each of the descriptors 0, 1 and 2 that is closed. Otherwise the next file that the program opens
/// would get the number of standard output or standard error, and text for users would end up in that file.
/// As with a closed descriptor, input and output still fail.
void occupy_standard_descriptors();

/// Throws BadInput unless `path` ends in `extension` and is either a pipe, a device, or a path at which a
/// file can be created. Permission to write to a pipe or a device is not checked. The message names `option`.
void check_writable(const std::filesystem::path& path, const std::string& option,
                    const std::string& extension);

/// The file that holds the code of this function: the program, or the shared library that Python loads.
std::filesystem::path file_of_this_code();

/// The hash of file_of_this_code(). Unlike the commit's hash, this hash also changes with the compiler, the
/// flags and code that is not committed. The file is read once per process.
const std::string& fingerprint_of_code();

}  // namespace voxspring
