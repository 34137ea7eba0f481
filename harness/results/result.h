// The result of a study in memory. A file has it as JSON in Google Benchmark's schema, with further fields.
#pragma once

#include <concepts>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "harness/results/row.h"
#include "harness/results/row_fields.h"

namespace voxspring {

/// A list of rows of a result. ListOf, below, knows the type of the rows.
class List {
public:
    virtual ~List() = default;
    virtual std::size_t size() const = 0;
    virtual nlohmann::json json() const = 0;
    virtual void add(const nlohmann::json& row) = 0;
};

template <class T>
class ListOf final : public List {
public:
    std::vector<T> rows;

    std::size_t size() const override { return rows.size(); }
    nlohmann::json json() const override {
        nlohmann::json all = nlohmann::json::array();
        for (const T& row : rows) all.push_back(json_of(row));
        return all;
    }
    void add(const nlohmann::json& row) override { rows.push_back(row_of_json<T>(row)); }
};

class Result {
public:
    /// A result without rows. It has the lists that every result has, all empty.
    Result();

    /// The file's object `context`: Google Benchmark's fields, and our object `voxspring`.
    nlohmann::json context = nlohmann::json::object();
    nlohmann::json& own_context() { return context["voxspring"]; }
    const nlohmann::json& own_context() const { return context.at("voxspring"); }

    /// The rows of the list `list`, which is added if it does not exist. Throws std::bad_cast if the rows of
    /// an existing list are not of type T.
    template <class T = Row>
    std::vector<T>& rows(const std::string& list) {
        std::unique_ptr<List>& found = lists_[list];
        if (!found) found = std::make_unique<ListOf<T>>();
        return dynamic_cast<ListOf<T>&>(*found).rows;
    }
    /// The rows of the list `list`. Throws std::out_of_range if there is no such list, and std::bad_cast if
    /// its rows are not of type T.
    template <class T = Row>
    const std::vector<T>& rows(const std::string& list) const {
        return dynamic_cast<const ListOf<T>&>(*lists_.at(list)).rows;
    }
    /// Adds a row that comes as JSON, from a worker process or from a file. A list that does not exist is
    /// added, with rows of type nlohmann::json.
    void add(const std::string& list, const nlohmann::json& row);
    const std::map<std::string, std::unique_ptr<List>>& lists() const { return lists_; }

private:
    std::map<std::string, std::unique_ptr<List>> lists_;
};

/// The JSON of the file (results/schema.json). The unit of each counter, and whether less or more is better,
/// are in the object `context`.
void to_json(nlohmann::json& json, const Result& result);

/// `context.voxspring`: the build (commit, whether the tree was clean, compilers, their flags) and the
/// processor and operating system that it runs on. The study adds the rest.
nlohmann::json build_context();

}  // namespace voxspring
