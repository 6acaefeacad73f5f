#include "server/worker/report/findings.h"

#include "core/drawing/markup.h"

#include <algorithm>

namespace saltus::report {

using namespace drawing;

namespace {

constexpr double much_beyond = 0.02;      // of the fixed voxels
constexpr double much_gap_at_most = 0.5;  // of the mean slip, 95 % of the surface
constexpr double much_drift = 0.01;       // of the Hamiltonian
constexpr double inverse_in_voxels = 0.5;

std::string plural(std::size_t n, const std::string& one) {
  return std::to_string(n) + ' ' + one + (n == 1 ? "" : "s");
}

Finding landmark_finding(const std::optional<LandmarkMeasures>& landmarks) {
  if (!landmarks)
    return {Verdict::Look,
            "No landmarks were given, so how far the result is off is not known: similarity and smoothness do not show "
            "it. --fixed-points and --moving-points measure it."};
  const Statistics before = summarise(landmarks->before), after = summarise(landmarks->after);
  std::size_t worse = 0;
  for (std::size_t i = 0; i < landmarks->after.size(); ++i) worse += landmarks->after[i] > landmarks->before[i];
  const std::string text = "The mean landmark error went from " + number(before.mean) + " to " + number(after.mean) +
                           " mm (" + plural(after.n, "landmark") + ", 90 % below " + number(after.p90) +
                           " mm, largest " + number(after.max) + " mm); " +
                           (worse == 0   ? "none of these is"
                            : worse == 1 ? "1 landmark of these is"
                                         : std::to_string(worse) + " landmarks of these are") +
                           " farther off than before.";
  if (after.mean < before.mean) return {2 * worse > after.n ? Verdict::Look : Verdict::Good, text};
  return {Verdict::Bad,
          text +
              " If the landmarks are right, the images did not match. If they are not: do both files count "
              "in world mm (LPS), row by row, fixed points in the fixed image?"};
}

Finding similarity_finding(const RegistrationSummary& summary) {
  const double before = summary.similarity_before, after = summary.similarity_after;
  const std::string values = number(before) + " to " + number(after);
  if (after < before) return {Verdict::Good, "The images agree better than before: dissimilarity " + values + "."};
  return {Verdict::Bad, "The images agree no better than before: dissimilarity " + values + "."};
}

template <int Dim>
Finding fold_finding(const Analysis<Dim>& analysis) {
  const FoldedVoxels& folded = analysis.folded;
  if (folded.n == 0)
    return {Verdict::Good, "Nothing folds: the Jacobian determinant is between " + number(analysis.jacobian.min) +
                               " and " + number(analysis.jacobian.max) + "."};
  std::string text =
      plural(folded.n, "voxel") + (folded.n == 1 ? " has" : " have") + " a Jacobian determinant that is not positive, ";
  if (folded.off_interface == 0)
    return {Verdict::Look,
            text +
                "all within two voxels of the interface, where the differences that it is made of bridge "
                "the jump."};
  return {Verdict::Bad, text + std::to_string(folded.off_interface) +
                            " of them away from every interface: the motion folds there. A larger regularisation or a "
                            "coarser start holds it back."};
}

/// "12.3 cm²", "48 mm".
template <int Dim>
std::string area_text(double area) {
  if (Dim == 2) return number(area) + " mm";
  return area >= 100 ? number(area / 100) + " cm\u00b2" : number(area) + " mm\u00b2";
}

template <int Dim>
Finding slip_finding(const SlipSummary& slip) {
  if (!(slip.area > 0)) return {Verdict::Good, "No sliding interface found: no momentum makes the motion jump."};
  const std::string text = "The motion slides along " + area_text<Dim>(slip.area) + " of interface, by " +
                           number(slip.jump_mean_mm) + " mm (mean; 95 % of it below " + number(slip.jump_p95_mm) +
                           ", largest " + number(slip.jump_max_mm) + " mm)";
  const std::string gaps = "the sides come apart by up to " + number(slip.gap_p95_mm) + " mm and overlap by up to " +
                           number(slip.overlap_p95_mm) + " mm (95 % of it)";
  if (std::max(slip.gap_p95_mm, slip.overlap_p95_mm) <= much_gap_at_most * slip.jump_mean_mm)
    return {Verdict::Good, text + "; across it " + gaps + "."};
  return {Verdict::Look, text + ", but across it " + gaps + ", which tissue that only slides does not."};
}

template <int Dim>
Finding interface_finding(const ReportInput<Dim>& input, const Analysis<Dim>& analysis) {
  if (analysis.may_slide) return slip_finding<Dim>(analysis.slip);
  const DetectedInterface<Dim>& interface = analysis.interface;
  if (interface.faces.empty())
    return {Verdict::Good, "The motion found is smooth: nowhere does it jump by " + number(interface.threshold_mm) +
                               " mm between neighbouring voxels."};
  return {Verdict::Look,
          "The motion found is smooth, since no first-order momenta take part" +
              std::string(input.options->model == Model::Auto ? " (auto found too little simple shear)" : "") +
              ", but along " + extent_text(interface) + " it changes by " + number(interface.slip_mm.median) +
              " mm (median) from voxel to voxel. Where tissue slides there, --model sliding lets it."};
}

/// Where first-order momenta wanted to be in more blocks than may be active.
std::vector<Finding> bound_findings(const RegistrationSummary& summary, const RegistrationOptions& used) {
  std::string where;
  double most = 0;
  for (const LevelSummary& level : summary.levels) {
    if (!(level.kept_out_share > 0)) continue;
    where += (where.empty() ? "level " : ", level ") + std::to_string(level.level);
    most = std::max(most, level.kept_out_share);
  }
  if (where.empty()) return {};
  return {{Verdict::Look, "First-order momenta wanted to be in more places than may hold them (most_active_share, " +
                              percentage(used.momenta.most_active_share) + "): " + where + ", up to " +
                              percentage(most) +
                              " of all more. Those that pull hardest are there. A larger share lets in the others and "
                              "takes more memory; a larger sparsity asks for fewer."}};
}

std::vector<Finding> level_findings(const RegistrationSummary& summary) {
  std::vector<Finding> found;
  std::string unfinished;
  for (const LevelSummary& level : summary.levels) {
    if (level.termination == Termination::Converged || level.termination == Termination::Settled ||
        level.termination == Termination::NoiseFloor)
      continue;
    unfinished += (unfinished.empty() ? "level " : ", level ") + std::to_string(level.level) + " (" +
                  to_string(level.termination) + ")";
  }
  if (unfinished.empty() && !summary.levels.empty()) return {{Verdict::Good, "Every level came to its end by itself."}};
  if (!unfinished.empty())
    found.push_back({Verdict::Look, "Not every level came to its end by itself: " + unfinished +
                                        ". After an iteration limit more iterations (--set max_iterations=N) may still "
                                        "improve the result."});
  return found;
}

}  // namespace

std::string to_string(Verdict verdict) {
  switch (verdict) {
    case Verdict::Good:
      return "good";
    case Verdict::Look:
      return "look";
    case Verdict::Bad:
      return "bad";
  }
  return "";
}

template <int Dim>
std::vector<Finding> findings(const ReportInput<Dim>& input, const Analysis<Dim>& analysis) {
  const RegistrationSummary& summary = input.result->summary;
  std::vector<Finding> all;
  for (const std::string& notice : summary.notices) all.push_back({Verdict::Look, notice + "."});
  all.push_back(landmark_finding(analysis.landmarks));
  all.push_back(similarity_finding(summary));
  all.push_back(fold_finding(analysis));
  all.push_back(interface_finding(input, analysis));
  if (analysis.share_beyond_moving > much_beyond)
    all.push_back({Verdict::Look, percentage(analysis.share_beyond_moving) +
                                      " of the fixed image lies beyond the moving image after the motion; there the "
                                      "moving image's border is all there is to compare with."});
  for (const Finding& finding : level_findings(summary)) all.push_back(finding);
  for (const Finding& finding : bound_findings(summary, input.result->options)) all.push_back(finding);
  if (const double voxel = input.input->fixed.grid.spacing.minCoeff();
      summary.inverse_consistency_mm > inverse_in_voxels * voxel)
    all.push_back({Verdict::Look, "There and back again ends " + number(summary.inverse_consistency_mm) +
                                      " mm off (median), more than half a voxel; more time steps bring it down."});
  if (summary.hamiltonian_drift > much_drift)
    all.push_back({Verdict::Look, "The energy of the motion, which should stay the same along a geodesic, changes by " +
                                      percentage(summary.hamiltonian_drift) +
                                      ": the path is one to no more than that."});
  return all;
}

template std::vector<Finding> findings(const ReportInput<2>&, const Analysis<2>&);
template std::vector<Finding> findings(const ReportInput<3>&, const Analysis<3>&);

}  // namespace saltus::report
