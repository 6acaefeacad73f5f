#pragma once

#include "core/optimisation/lbfgs.h"
#include "core/registration/checkpoint.h"
#include "core/registration/image_pyramid.h"
#include "core/registration/matching_objective.h"
#include "core/registration/progress.h"
#include "core/registration/register_images.h"
#include "core/registration/scales.h"
#include "core/registration/sparsity_rounds.h"
#include "core/registration/work_meter.h"
#include "core/support/stopwatch.h"

#include <memory>
#include <optional>

namespace saltus {

/// The optimisation of a registration, level by level from coarse to fine, each in its rounds; what it decides on the
/// way, how it is interrupted, and how it goes on from a checkpoint.
///
/// While no first-order momentum exists and none may appear, order 0 is alone: all velocities are smooth, and momenta,
/// flow and map live on a coarser lattice than the images (flow.coarsening); else flow_lattice_beside_first. With
/// momenta.first_order_shear each level begins so, and its displacement then tells whether first orders are worth it;
/// once they were, all finer levels have them. Where they were not on the finest one, order 0 may get finer scales and
/// be asked again (momenta.finer_shear). With all of its scales it may get a narrower one (momenta.narrower_pull).
template <int Dim>
class PyramidRun {
 public:
  using Scalar = float;

  /// All but `asked` must outlive this. Throws InvalidInput for a checkpoint that is damaged or of another
  /// job.
  PyramidRun(const RegistrationInput<Dim>& input, const RegistrationOptions& asked, const Field<double>& directions,
             bool is_blank, const ProgressCallback& progress, const Checkpointing& checkpointing);
  PyramidRun(const PyramidRun&) = delete;  // its pyramid refers to its options
  PyramidRun& operator=(const PyramidRun&) = delete;

  /// Until the finest level has ended or the callback asks to stop. Once only.
  void run();

  /// What was asked for, resolved for the images, their noise and contrast.
  const RegistrationOptions& options() const { return options_; }
  const ImagePyramid<Dim>& pyramid() const { return pyramid_; }
  /// Levels, history and termination; times until now.
  RegistrationSummary& summary() { return summary_; }
  void count_time();

  // What the last level has left behind.
  MatchingObjective<Dim, Scalar>& objective() { return *objective_; }
  const std::vector<Scalar>& momenta() const { return reached_.minimiser.x; }
  const std::vector<MomentumScale<Dim, Scalar>*>& scales() const { return active_; }
  /// Gives up images and objective of the last level, which are not needed for what comes after.
  void release();

 private:
  void begin_level(std::size_t step);
  void run_rounds();
  void end_level();
  bool is_smooth(const SparsityRound& round) const;
  bool has_first_at(int level) const;
  bool has_found() const;
  bool decides_at(int level) const;
  double planned_work(int level, bool lets_in) const;
  Lattice<Dim> flow_lattice(bool smooth) const;
  bool make_objective(const SparsityRound& round);
  void choose_map_steps();
  void ask_for_narrow_widths();
  double narrow_share() const;
  double shear_reached();
  bool shows_slip(double least_shear);
  bool first_orders_are_worth_it();
  bool may_be_finer() const;
  bool is_at_rest() const;
  bool may_be_narrower();
  const PlacedScale<Dim, Scalar>& finest_zeroth() const;
  bool finds_narrow_pull();
  bool has_narrower() const;
  void begin_narrower();
  void make_scales_anew(const RegistrationOptions& options, double narrow_share);
  void begin_finer_scales();
  void end_finer_scales();
  bool goes_on(std::size_t round);
  void look_how_quick_it_was();
  bool would_join();
  double regularisation_beside() const;
  void begin_beside_first_orders();
  void begin_round(std::size_t round);
  void minimise_round(std::size_t round);
  MinimiseSummary minimise_as(const MinimiseOptions& how);
  MinimiseSummary minimise_until_slip_shows();
  std::optional<MinimiseSummary> ask_when_settled(double tolerance, int most_iterations);
  void count_round();
  bool report();
  bool accept(const MinimiseStep& taken);
  void expect_of_level();
  void count_work(double share);
  void make_checkpoint(std::ostream& out);
  void count_level_time(LevelSummary& at) const;

  RegistrationOptions options_;
  const Field<double>& directions_;
  const bool is_blank_;
  const ProgressCallback& progress_;
  const Checkpointing& checkpointing_;
  const Stopwatch whole_;
  double seconds_before_ = 0, cpu_seconds_before_ = 0;  ///< of the runs that the checkpoint comes from
  ImagePyramid<Dim> pyramid_;
  std::vector<PlacedScale<Dim, Scalar>> scales_;
  std::vector<int> levels_;  ///< of the pyramid, coarsest first
  WorkMeter meter_;
  std::uint64_t job_ = 0;
  Checkpoint reached_;  ///< where the run stands; what only a blob needs is filled in when one is made
  bool is_resumed_ = false;
  bool is_beside_first_ =
      false;  ///< whether order 0 has the weight, and all the widths, that it has beside first orders
  RegistrationSummary summary_;

  int map_steps_ = 1;         ///< of the next level
  double shear_before_ = -1;  ///< of the next level, see LevelSummary

  // Of the level at hand.
  bool showed_slip_ = false;          ///< order 0 when it had settled, see ask_when_settled
  int asked_at_ = -1;                 ///< iterations of the round by then; -1: it has not been asked
  bool gives_up_sharp_ = false;       ///< order 0, when the next round begins, see momenta.quick_share
  std::vector<Scalar> before_round_;  ///< momenta, where it did, until a step is taken
  std::size_t step_ = 0;
  MatchingLevel<Dim, Scalar> images_;
  std::vector<SparsityRound> rounds_;
  bool has_first_ = false, decides_ = false;
  std::vector<MomentumScale<Dim, Scalar>*> active_;  ///< that take part in the objective
  std::unique_ptr<MatchingObjective<Dim, Scalar>> objective_;
  MinimiseOptions how_;
  LevelSummary level_;
  Progress now_;
  std::unique_ptr<Stopwatch> watch_;
  double level_seconds_before_ = 0, level_cpu_seconds_before_ = 0;
  Stopwatch round_watch_;
  bool is_counted_ = false;      ///< the round at hand, in level_
  double round_work_ = 0;        ///< since the round began, in the meter's unit
  double seconds_per_work_ = 0;  ///< 0 while unknown
  double counted_ = 0;           ///< share of the evaluation at hand that the meter has
};

}  // namespace saltus
