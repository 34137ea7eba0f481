// Writes VTK's XML files.
#pragma once

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "harness/export/arrays.h"
#include "harness/export/snapshot.h"

namespace voxspring {

/// An attribute as XML: ` name="1"`.
inline std::string attribute(const std::string& name, std::size_t value) {
    return fmt::format(" {}=\"{}\"", name, value);
}
/// An attribute of several numbers as XML: ` name="1 0 0.5"`.
inline std::string attribute(const std::string& name, const std::vector<double>& numbers) {
    return fmt::format(" {}=\"{:.17g}\"", name, fmt::join(numbers, " "));
}

/// A VTK XML file whose arrays follow the XML as raw bytes ("appended raw").
class VtkFile {
public:
    /// `type` is VTK's name of the dataset.
    explicit VtkFile(const std::string& type)
        : xml_("<?xml version=\"1.0\"?>\n<VTKFile type=\"" + type +
               "\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n") {}

    /// Opens a tag, such as `Piece NumberOfPoints="3"`, which end() closes.
    void begin(const std::string& tag) {
        xml_ += "<" + tag + ">\n";
        open_.push_back(tag.substr(0, tag.find(' ')));
    }
    void end() {
        xml_ += "</" + open_.back() + ">\n";
        open_.pop_back();
    }

    template <class Value>
    void array(const std::string& name, const std::vector<Value>& values) {
        const ArrayBytes array = bytes_of(values);
        xml_ += fmt::format(
            R"(<DataArray type="{}{}" Name="{}" NumberOfComponents="{}"{} format="appended" offset="{}"/>)",
            array.kind == 'f'   ? "Float"
            : array.kind == 'i' ? "Int"
                                : "UInt",
            8 * array.width, name, array.components,
            // Field data needs its length here, which nothing else in the file gives.
            open_.back() == "FieldData" ? attribute("NumberOfTuples", array.count) : "", offset_);
        xml_ += '\n';
        offset_ += sizeof(std::uint64_t) + array.bytes.size();
        blocks_.emplace_back(array.bytes);
    }

    /// Returns the whole file. Frees each array once it is copied.
    std::string bytes() {
        std::string file = std::move(xml_);
        file += "<AppendedData encoding=\"raw\">\n_";
        const std::string tail = "\n</AppendedData>\n</VTKFile>\n";
        file.reserve(file.size() + offset_ + tail.size());
        for (std::string& block : blocks_) {
            const std::uint64_t size = block.size();
            file.append(reinterpret_cast<const char*>(&size), sizeof size);
            file += block;
            std::string().swap(block);
        }
        file += tail;
        return file;
    }

private:
    std::string xml_;
    std::vector<std::string> open_, blocks_;
    std::uint64_t offset_ = 0;
};

/// Adds the state's time and step. ParaView recognises TimeValue by its name.
inline void add_time(VtkFile& file, const Snapshot& snapshot) {
    file.begin("FieldData");
    file.array("TimeValue", std::vector<double>{snapshot.time});
    file.array("step", std::vector<std::int64_t>{snapshot.step});
    file.end();
}

}  // namespace voxspring
