#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace saltus::cli {

/// What a finished pair of a list leaves beside its results, last of all, {"request": a hash}: the list does not do it
/// again.
inline constexpr const char* done_file = "pair.json";

/// That a list has left its mark in `folder`.
bool is_marked_done(const std::filesystem::path& folder);

/// Throws InvalidInput, which names `option`, where `input` (also through links) lies in `out` under the name of a
/// result: a new one would take its place, or remove it.
void refuse_input_among_results(const std::string& option, const std::filesystem::path& input,
                                const std::filesystem::path& out);

/// That `folder` holds the report of a registration, so that what has the name of a result there is one.
bool holds_result(const std::filesystem::path& folder);

/// What an earlier registration has left in `folder`, where the files `names` of a new one have taken their places: the
/// same images in another format, which would be read in place of the new ones, and momenta that the new result has
/// none of. Never anything that no registration writes. In the order of their names.
std::vector<std::filesystem::path> outdated_files(const std::filesystem::path& folder,
                                                  const std::vector<std::string>& names);

}  // namespace saltus::cli
