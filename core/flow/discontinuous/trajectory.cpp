#include "core/flow/discontinuous/trajectory.h"

#include "core/flow/discontinuous/event_location.h"
#include "core/support/errors.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace saltus {
namespace {

/// Where the flow goes from a surface, given how H changes along the velocities of both sides.
enum class Fate { ToPlus, ToMinus, Slide, Escape, Graze };

Fate fate_at_start(double along_minus, double along_plus, double bound) {
  if (along_minus > bound && along_plus < -bound) return Fate::Slide;
  if (along_minus > bound && along_plus > bound) return Fate::ToPlus;
  if (along_minus < -bound && along_plus < -bound) return Fate::ToMinus;
  if (along_minus < -bound && along_plus > bound) return Fate::Escape;
  return Fate::Graze;
}

template <int Dim>
class Follower {
 public:
  static constexpr int states = Dim + Dim * Dim;
  using Step = DormandPrinceStep<states>;
  using State = typename Step::State;

  Follower(const PiecewiseVelocity<Dim>& velocity, const Vector<Dim>& start, double time, double until,
           const TrajectoryOptions& options)
      : velocity_(velocity),
        options_(options),
        until_(until),
        sides_(static_cast<std::size_t>(velocity.surfaces()), 0) {
    held_.assign(sides_.size(), false);
    found_.time = time;
    found_.position = start;
    found_.fundamental.setIdentity();
  }

  Trajectory<Dim> run() {
    std::vector<double> ends;
    for (double end : velocity_.time_breaks())
      if (end > found_.time && end < until_) ends.push_back(end);
    ends.push_back(until_);
    if (!start_sides()) return std::move(found_);
    double length = options_.max_step;
    for (double end : ends)
      while (found_.time < end)
        if (!advance(end, length)) return std::move(found_);
    return std::move(found_);
  }

 private:
  bool end_as(TrajectoryEnd ending) {
    found_.ending = ending;
    return false;
  }

  double gap(const SurfaceJet<Dim>& jet) const { return jet.value / jet.gradient.norm(); }

  VelocityJet<Dim> on_side(int surface, signed char side) {
    const signed char kept = std::exchange(sides_[surface], side);
    const VelocityJet<Dim> jet = velocity_.velocity(found_.time, found_.position, sides_);
    sides_[surface] = kept;
    return jet;
  }

  /// |H_t + g.v| up to which an approach is grazing.
  double grazing_bound(const SurfaceJet<Dim>& jet, const Vector<Dim>& minus, const Vector<Dim>& plus) const {
    const double slope = jet.gradient.norm();
    return options_.grazing * std::max({minus.norm() * slope, plus.norm() * slope, std::abs(jet.rate)});
  }

  /// Sides of the surfaces about the start; a point on one of them goes where the flow goes.
  bool start_sides() {
    velocity_.surfaces_near(found_.time, found_.position, 0, near_);
    std::vector<int> touched;
    for (int k : near_) {
      const SurfaceJet<Dim> jet = velocity_.surface(k, found_.time, found_.position);
      if (!jet.exists) continue;
      if (std::abs(gap(jet)) <= options_.event_tolerance) touched.push_back(k);
      sides_[k] = jet.value >= 0 ? 1 : -1;
    }
    if (touched.size() > 1) return end_as(TrajectoryEnd::Corner);
    if (touched.empty()) return true;
    const int k = touched.front();
    const SurfaceJet<Dim> jet = velocity_.surface(k, found_.time, found_.position);
    const VelocityJet<Dim> minus = on_side(k, -1), plus = on_side(k, 1);
    const double bound = grazing_bound(jet, minus.value, plus.value);
    switch (fate_at_start(jet.along(minus.value), jet.along(plus.value), bound)) {
      case Fate::ToPlus:
        sides_[k] = 1;
        return true;
      case Fate::ToMinus:
        sides_[k] = -1;
        return true;
      case Fate::Slide:
        // The start of the sliding lies before the trajectory; neighbours are taken as they move from here on.
        sliding_ = k;
        record(EventKind::Sliding, k, jet, plus.value, sliding_motion(jet, minus, plus).velocity.value,
               Matrix<Dim>::Identity());
        return true;
      case Fate::Escape:
        return end_as(TrajectoryEnd::Escaping);
      case Fate::Graze:
        return graze(k, jet, plus.value);
    }
    return true;
  }

  bool graze(int k, const SurfaceJet<Dim>& jet, const Vector<Dim>& v) {
    record(EventKind::Grazing, k, jet, v, v, Matrix<Dim>::Identity());
    if (options_.when_grazing == GrazingRule::Stop) return end_as(TrajectoryEnd::Grazing);
    held_[k] = true;
    return true;
  }

  void record(EventKind kind, int k, const SurfaceJet<Dim>& jet, const Vector<Dim>& before, const Vector<Dim>& after,
              const Matrix<Dim>& jump) {
    found_.events.push_back({kind, k, found_.time, found_.position, before, after, jet, jump, found_.steps.size()});
    found_.fundamental = jump * found_.fundamental;
  }

  Step step_of(double length) {
    State y = State::Zero();
    y.template head<Dim>() = found_.position;
    for (int c = 0; c < Dim; ++c) y[Dim + Dim * c + c] = 1;
    return Step(found_.time, y, length, [this](double t, const State& state) {
      const VelocityJet<Dim> jet = velocity_of_piece<Dim>(velocity_, t, state.template head<Dim>(), sides_, sliding_);
      State rate;
      rate.template head<Dim>() = jet.value;
      for (int c = 0; c < Dim; ++c)
        rate.template segment<Dim>(Dim + Dim * c) = jet.jacobian * state.template segment<Dim>(Dim + Dim * c);
      return rate;
    });
  }

  /// One accepted step, cut at its first event, and what happens there.
  bool advance(double end, double& length) {
    double h = std::min(length, options_.max_step);
    if (found_.time + 1.01 * h >= end) h = end - found_.time;
    const double smallest = 1e-13 * std::max(1.0, std::abs(found_.time));
    Step step;
    for (;;) {
      step = step_of(h);
      if (!step.end().allFinite()) {
        if (!velocity_of_piece<Dim>(velocity_, found_.time, found_.position, sides_, sliding_).value.allFinite())
          return end_as(TrajectoryEnd::NotFinite);
      }
      const double entries = 1 + step.end().template tail<Dim * Dim>().template lpNorm<Eigen::Infinity>();
      const double error = std::max(step.error().template head<Dim>().norm() / options_.position_tolerance,
                                    step.error().template tail<Dim * Dim>().template lpNorm<Eigen::Infinity>() /
                                        entries / options_.fundamental_tolerance);
      const bool accepted = error <= 1;
      const double factor = std::isfinite(error) ? std::clamp(0.9 * std::pow(error, -0.2), 0.2, 5.0) : 0.2;
      length = h * factor;
      if (accepted) break;
      h = length;
      if (h < smallest) return end_as(TrajectoryEnd::StepTooSmall);
    }
    const double grown = std::max(length, h);

    std::vector<std::pair<double, int>> hits;
    bool leaves = false;
    double cut = first_event(step, h, hits, leaves);
    if (hits.empty() && !leaves) {
      accept(step, h, end);
      return after_step();
    }
    length = grown;
    if (!leaves && hits.size() == 1) {
      const std::optional<double> sharp = sharpened(hits.front().second, cut, h);
      if (!sharp) {
        // The continuous extension and whole steps disagree on the event: a shorter step brings them together.
        length = 0.5 * h;
        return length >= smallest || end_as(TrajectoryEnd::StepTooSmall);
      }
      cut = *sharp;
    }
    if (cut > 0) {
      Step until_event = step_of(cut);
      if (leaves && !until_event.end().allFinite()) {
        // Where both sides turn at once the share of v+ is 0/0: stop just before.
        cut *= 1 - 1e-9;
        until_event = step_of(cut);
      }
      if (!until_event.end().allFinite()) return end_as(TrajectoryEnd::NotFinite);
      accept(until_event, cut, std::numeric_limits<double>::infinity());
    }
    if (static_cast<int>(found_.events.size()) >= options_.max_events) return end_as(TrajectoryEnd::TooManyEvents);
    if (leaves) return hits.empty() ? leave() : end_as(TrajectoryEnd::Corner);
    if (hits.size() > 1) return corner(hits);
    return arrive(hits.front().second);
  }

  void accept(const Step& step, double h, double end) {
    if (options_.keep_steps) found_.steps.push_back({found_.time, h, sides_, sliding_, step});
    found_.time = found_.time + h >= end - 1e-14 ? std::min(end, found_.time + h) : found_.time + h;
    if (std::isfinite(end) && end - found_.time < 1e-14 * std::max(1.0, std::abs(end))) found_.time = end;
    found_.position = step.end().template head<Dim>();
    Matrix<Dim> local;
    for (int c = 0; c < Dim; ++c) local.col(c) = step.end().template segment<Dim>(Dim + Dim * c);
    found_.fundamental = local * found_.fundamental;
    if (sliding_ < 0) return;
    // Rounding and truncation drift off the surface; the tolerance of a step bounds what this takes back.
    const SurfaceJet<Dim> jet = velocity_.surface(sliding_, found_.time, found_.position);
    if (jet.exists) found_.position -= jet.value / jet.gradient.squaredNorm() * jet.gradient;
  }

  /// The first event of a step, as a length from its start; all surfaces hit then.
  double first_event(const Step& step, double h, std::vector<std::pair<double, int>>& hits, bool& leaves) {
    const Vector<Dim> end = step.end().template head<Dim>();
    velocity_.surfaces_near(found_.time, found_.position, 1.5 * (end - found_.position).norm() + 1e-6, near_);
    const double speed = (end - found_.position).norm() / h;
    const double tolerance = std::clamp(options_.event_tolerance / (speed * h + 1e-300), 1e-15, 1e-3);
    const auto at = [&](double share) -> Vector<Dim> { return step.at(share).template head<Dim>(); };
    double first = std::numeric_limits<double>::infinity();
    std::vector<std::pair<double, int>> all;
    for (int k : near_) {
      if (k == sliding_ || held_[k] || sides_[k] == 0) continue;
      const double side = sides_[k];
      // A surface that ends somewhere along the step is looked for on the part where it is.
      bool whole = true;
      for (int i = 0; i <= kEventSamples && whole; ++i) {
        const double share = double(i) / kEventSamples;
        whole = velocity_.surface(k, found_.time + share * h, at(share)).exists;
      }
      const auto height = [&](double share) {
        const SurfaceJet<Dim> jet = velocity_.surface(k, found_.time + share * h, at(share));
        return jet.exists ? side * jet.value : 1.0;
      };
      const std::optional<double> root = first_fall(height, 0.0, 1.0, tolerance);
      if (!root) continue;
      if (!whole) {
        // Entered beside the edge, on the other side: no event; after_step gives the new side.
        const SurfaceJet<Dim> jet = velocity_.surface(k, found_.time + *root * h, at(*root));
        if (!jet.exists || std::abs(gap(jet)) > std::max(1e-6, 100 * tolerance * speed * h)) continue;
      }
      all.emplace_back(*root, k);
      first = std::min(first, *root);
    }
    std::optional<double> end_of_sliding;
    if (sliding_ >= 0) {
      const auto inflow = [&](double share) {
        const double t = found_.time + share * h;
        const Vector<Dim> x = at(share);
        const SurfaceJet<Dim> jet = velocity_.surface(sliding_, t, x);
        if (!jet.exists) return 1.0;
        Sides sides = sides_;
        sides[sliding_] = -1;
        const double from_minus = jet.along(velocity_.velocity(t, x, sides).value);
        sides[sliding_] = 1;
        return std::min(from_minus, -jet.along(velocity_.velocity(t, x, sides).value));
      };
      end_of_sliding = first_fall(inflow, 0.0, 1.0, tolerance);
      if (end_of_sliding) first = std::min(first, *end_of_sliding);
    }
    const double together = std::max(4 * tolerance, options_.event_tolerance);
    leaves = end_of_sliding && *end_of_sliding <= first + together;
    for (const auto& hit : all)
      if (hit.first <= first + together) hits.push_back(hit);
    return std::isfinite(first) ? first * h : h;
  }

  /// The continuous extension is of lower order than the step: the crossing is refined with whole steps up to it.
  /// Nothing when Newton's method does not find it within the step.
  std::optional<double> sharpened(int k, double cut, double h) {
    double best = cut;
    if (!(best > 0)) return best;
    for (int i = 0; i < 6; ++i) {
      const Vector<Dim> x = step_of(best).end().template head<Dim>();
      const SurfaceJet<Dim> jet = velocity_.surface(k, found_.time + best, x);
      if (!jet.exists) return {};
      if (std::abs(gap(jet)) <= 0.1 * options_.event_tolerance) return best;
      const double slope = jet.along(velocity_of_piece<Dim>(velocity_, found_.time + best, x, sides_, sliding_).value);
      const double next = best - jet.value / slope;
      if (!(next > 0 && next <= 1.0001 * h)) return {};
      best = next;
    }
    return {};
  }

  bool arrive(int k) {
    const SurfaceJet<Dim> jet = velocity_.surface(k, found_.time, found_.position);
    const signed char side = sides_[k];
    const bool was_sliding = sliding_ >= 0;
    const Vector<Dim> before = velocity_of_piece<Dim>(velocity_, found_.time, found_.position, sides_, sliding_).value;
    sides_[k] = static_cast<signed char>(-side);
    if (was_sliding && !still_slides()) {
      sides_[k] = side;
      return end_as(TrajectoryEnd::Corner);
    }
    const VelocityJet<Dim> beyond = velocity_of_piece<Dim>(velocity_, found_.time, found_.position, sides_, sliding_);
    sides_[k] = side;
    const Vector<Dim>&minus = side < 0 ? before : beyond.value, &plus = side < 0 ? beyond.value : before;
    const double bound = grazing_bound(jet, minus, plus);
    const double out = -side * jet.along(before), on = -side * jet.along(beyond.value);
    if (!(out > bound) || !(std::abs(on) > bound)) return graze(k, jet, before);
    if (on > 0) {
      record(EventKind::Crossing, k, jet, before, beyond.value,
             saltus::saltation(jet, before, beyond.value, options_.rule, false));
      sides_[k] = static_cast<signed char>(-side);
      return true;
    }
    if (was_sliding) return end_as(TrajectoryEnd::Corner);  // would slide along two surfaces
    const Vector<Dim> along = sliding_motion(jet, on_side(k, -1), on_side(k, 1)).velocity.value;
    record(EventKind::Sliding, k, jet, before, along, saltus::saltation(jet, before, along, options_.rule, true));
    sliding_ = k;
    return true;
  }

  bool still_slides() {
    const SurfaceJet<Dim> jet = velocity_.surface(sliding_, found_.time, found_.position);
    const Vector<Dim> minus = on_side(sliding_, -1).value, plus = on_side(sliding_, 1).value;
    const double bound = grazing_bound(jet, minus, plus);
    return jet.exists && jet.along(minus) > bound && jet.along(plus) < -bound;
  }

  bool leave() {
    const int k = sliding_;
    const SurfaceJet<Dim> jet = velocity_.surface(k, found_.time, found_.position);
    const VelocityJet<Dim> minus = on_side(k, -1), plus = on_side(k, 1);
    const double from_minus = jet.along(minus.value), from_plus = -jet.along(plus.value);
    const double bound = grazing_bound(jet, minus.value, plus.value);
    if (from_minus <= bound && from_plus <= bound) return end_as(TrajectoryEnd::Escaping);
    const signed char to = from_minus < from_plus ? -1 : 1;
    const Vector<Dim> v = to < 0 ? minus.value : plus.value;
    record(EventKind::Leaving, k, jet, v, v, Matrix<Dim>::Identity());
    sides_[k] = to;
    held_[k] = true;  // it leaves tangentially: no event before it is clear of the surface
    sliding_ = -1;
    return true;
  }

  /// Two surfaces at once: the derivative exists when both orders cross and give the same.
  bool corner(const std::vector<std::pair<double, int>>& hits) {
    if (hits.size() > 2 || sliding_ >= 0) return end_as(TrajectoryEnd::Corner);
    struct Passage {
      int first, second;
      SurfaceJet<Dim> jets[2];
      Vector<Dim> v[3];
      Matrix<Dim> jump[2];
      bool crosses = false;
    } passages[2] = {{hits[0].second, hits[1].second, {}, {}, {}}, {hits[1].second, hits[0].second, {}, {}, {}}};
    for (Passage& p : passages) {
      const Sides kept = sides_;
      const int order[2] = {p.first, p.second};
      p.v[0] = velocity_.velocity(found_.time, found_.position, sides_).value;
      p.crosses = true;
      for (int i = 0; i < 2; ++i) {
        const int k = order[i];
        p.jets[i] = velocity_.surface(k, found_.time, found_.position);
        sides_[k] = static_cast<signed char>(-sides_[k]);
        p.v[i + 1] = velocity_.velocity(found_.time, found_.position, sides_).value;
        const double bound = grazing_bound(p.jets[i], p.v[i], p.v[i + 1]);
        p.crosses =
            p.crosses && sides_[k] * p.jets[i].along(p.v[i]) > bound && sides_[k] * p.jets[i].along(p.v[i + 1]) > bound;
        if (p.crosses) p.jump[i] = saltus::saltation(p.jets[i], p.v[i], p.v[i + 1], options_.rule, false);
      }
      sides_ = kept;
    }
    if (!passages[0].crosses || !passages[1].crosses) return end_as(TrajectoryEnd::Corner);
    const Matrix<Dim> one = passages[0].jump[1] * passages[0].jump[0], two = passages[1].jump[1] * passages[1].jump[0];
    if ((one - two).norm() > 1e-6 * one.norm()) return end_as(TrajectoryEnd::Corner);
    const Passage& p = passages[0];
    record(EventKind::Crossing, p.first, p.jets[0], p.v[0], p.v[1], p.jump[0]);
    record(EventKind::Crossing, p.second, p.jets[1], p.v[1], p.v[2], p.jump[1]);
    sides_[p.first] = static_cast<signed char>(-sides_[p.first]);
    sides_[p.second] = static_cast<signed char>(-sides_[p.second]);
    return true;
  }

  /// Sides of surfaces that come into reach or end, and surfaces that were kept away from.
  bool after_step() {
    for (int k : near_) {
      const SurfaceJet<Dim> jet = velocity_.surface(k, found_.time, found_.position);
      if (!jet.exists) {
        if (k == sliding_) {
          const Vector<Dim> v = velocity_of_piece<Dim>(velocity_, found_.time, found_.position, sides_, sliding_).value;
          record(EventKind::Leaving, k, jet, v, v, Matrix<Dim>::Identity());
          sliding_ = -1;
        }
        sides_[k] = 0;
        held_[k] = false;
        continue;
      }
      if (k == sliding_) continue;
      if (sides_[k] == 0) sides_[k] = jet.value >= 0 ? 1 : -1;
      if (held_[k]) {
        if (sides_[k] * gap(jet) > options_.event_tolerance) {
          held_[k] = false;
        } else if (sides_[k] * gap(jet) < 0) {
          const Vector<Dim> v = velocity_of_piece<Dim>(velocity_, found_.time, found_.position, sides_, sliding_).value;
          if (-sides_[k] * jet.along(v) > grazing_bound(jet, v, v)) {
            held_[k] = false;
            if (static_cast<int>(found_.events.size()) >= options_.max_events)
              return end_as(TrajectoryEnd::TooManyEvents);
            if (!arrive(k)) return false;
          }
        }
      } else if (sides_[k] * jet.value < 0 && std::abs(gap(jet)) > options_.event_tolerance) {
        sides_[k] = static_cast<signed char>(-sides_[k]);  // came round the edge of a surface that ends
      }
    }
    return true;
  }

  const PiecewiseVelocity<Dim>& velocity_;
  const TrajectoryOptions& options_;
  double until_;
  Sides sides_;
  std::vector<bool> held_;  ///< surfaces that are not looked at until the point is clear of them
  int sliding_ = -1;
  std::vector<int> near_;
  Trajectory<Dim> found_;
};

}  // namespace

std::string to_string(TrajectoryEnd end) {
  switch (end) {
    case TrajectoryEnd::Complete:
      return "complete";
    case TrajectoryEnd::Escaping:
      return "escaping";
    case TrajectoryEnd::Grazing:
      return "grazing";
    case TrajectoryEnd::Corner:
      return "corner";
    case TrajectoryEnd::TooManyEvents:
      return "too many events";
    case TrajectoryEnd::StepTooSmall:
      return "step too small";
    case TrajectoryEnd::NotFinite:
      return "not finite";
  }
  return "unknown";
}

void check(const TrajectoryOptions& options) {
  const auto positive = [](const char* name, double value) {
    if (!(value > 0)) throw InvalidInput(std::string(name) + " is " + std::to_string(value) + "; it must be positive");
  };
  positive("position_tolerance", options.position_tolerance);
  positive("fundamental_tolerance", options.fundamental_tolerance);
  positive("event_tolerance", options.event_tolerance);
  positive("max_step", options.max_step);
  positive("max_events", options.max_events);
}

template <int Dim>
int Trajectory<Dim>::count(EventKind kind) const {
  return static_cast<int>(
      std::count_if(events.begin(), events.end(), [&](const auto& event) { return event.kind == kind; }));
}

template <int Dim>
VelocityJet<Dim> velocity_of_piece(const PiecewiseVelocity<Dim>& velocity, double t, const Vector<Dim>& x, Sides& sides,
                                   int sliding) {
  if (sliding < 0) return velocity.velocity(t, x, sides);
  const SurfaceJet<Dim> jet = velocity.surface(sliding, t, x);
  const signed char kept = sides[sliding];
  sides[sliding] = -1;
  const VelocityJet<Dim> minus = velocity.velocity(t, x, sides);
  sides[sliding] = 1;
  const VelocityJet<Dim> plus = velocity.velocity(t, x, sides);
  sides[sliding] = kept;
  if (jet.exists) return sliding_motion(jet, minus, plus).velocity;
  // A trial step beyond the edge of the surface: both sides agree there up to what is left of the jump.
  VelocityJet<Dim> mean;
  mean.value = 0.5 * (minus.value + plus.value);
  mean.jacobian = 0.5 * (minus.jacobian + plus.jacobian);
  return mean;
}

template <int Dim>
Trajectory<Dim> follow(const PiecewiseVelocity<Dim>& velocity, const Vector<Dim>& start, double time, double until,
                       const TrajectoryOptions& options) {
  if (!(until > time))
    throw InvalidInput("until is " + std::to_string(until) + " and not after time " + std::to_string(time) +
                       "; use ReversedVelocity to go back");
  check(options);
  return Follower<Dim>(velocity, start, time, until, options).run();
}

#define SALTUS_TRAJECTORY(DIM)                                                                                         \
  template struct Trajectory<DIM>;                                                                                     \
  template VelocityJet<DIM> velocity_of_piece(const PiecewiseVelocity<DIM>&, double, const Vector<DIM>&, Sides&, int); \
  template Trajectory<DIM> follow(const PiecewiseVelocity<DIM>&, const Vector<DIM>&, double, double,                   \
                                  const TrajectoryOptions&);
SALTUS_TRAJECTORY(2)
SALTUS_TRAJECTORY(3)
#undef SALTUS_TRAJECTORY

}  // namespace saltus
