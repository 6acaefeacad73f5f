#pragma once

#include "core/registration/options.h"
#include "core/registration/register_images.h"
#include "core/registration/result.h"

#include <cstddef>
#include <map>
#include <string>
#include <vector>

namespace saltus::report {

/// What a finished registration is reported from. The pointers must be set and are only read.
template <int Dim>
struct ReportInput {
  const RegistrationInput<Dim>* input = nullptr;
  const RegistrationResult<Dim>* result = nullptr;
  const RegistrationOptions* options = nullptr;
  std::vector<Vector<Dim>> fixed_points;  ///< landmarks, world mm (LPS); none, or as many as moving_points
  std::vector<Vector<Dim>> moving_points;
  std::string title;                               ///< shown on the page; any text
  std::size_t peak_memory_bytes = 0;               ///< 0: not known
  std::string program;                             ///< name and version of what ran, such as "saltus 1.2.0"
  std::map<std::string, std::string> digests;      ///< of the input files, by role: "fixed" -> "sha256:..."
  std::map<std::string, std::string> job_options;  ///< what else the job asked for, by the name of saltus's option
  std::map<std::string, double> stage_seconds;     ///< wall seconds of what was done around the registration, by name
};

template <int Dim>
struct Analysis;  // analysis.h

/// The report for programs: settings, grids, levels, convergence, similarity, landmark errors, Jacobian, timings.
/// server/worker/report/README.md lists the fields. `analysis` is that of `input`.
template <int Dim>
std::string report_json(const ReportInput<Dim>& input, const Analysis<Dim>& analysis);

/// The same for people: one HTML page with its pictures inside, which loads nothing from anywhere.
template <int Dim>
std::string report_html(const ReportInput<Dim>& input, const Analysis<Dim>& analysis);

}  // namespace saltus::report
