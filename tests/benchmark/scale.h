#pragma once

#include <filesystem>
#include <iosfwd>
#include <string>
#include <vector>

#include "tests/benchmark/scatter_plot.h"
#include "tests/benchmark/table.h"

namespace saltus::benchmark {

/// Registers one thorax of `size` voxels an axis (of the same extent, whatever the size) in this process, with the
/// defaults of the model in one thread and few iterations, and prints one line of figures for scale_rows.
void run_scale_child(int size, const std::string& model, std::ostream& out);

/// Time and memory against the size of the images, each size in a process of its own, `program` with the argument
/// `scale-child`: its largest memory beside what memory_estimate declares for it. A run that takes more than 1.1 times
/// that is a complaint; one that would take more than is free, judged by the one before, is left out.
std::vector<Row> scale_rows(const std::filesystem::path& program, const std::vector<int>& sizes,
                            const std::string& model, const std::filesystem::path& folder, std::ostream& progress);
std::vector<Column> scale_columns();

/// Both against the number of voxels, with what would be proportional to it.
ScatterPlot plot_of_scale(const std::vector<Row>& rows);

}  // namespace saltus::benchmark
