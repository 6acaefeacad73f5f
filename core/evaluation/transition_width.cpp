#include "core/evaluation/transition_width.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <sstream>

#include "core/evaluation/field_sampling.h"
#include "core/evaluation/grid_agreement.h"
#include "core/evaluation/statistics.h"
#include "core/support/errors.h"

namespace saltus {
namespace {

void require_reach(double reach_mm) {
  if (reach_mm > 0 && std::isfinite(reach_mm)) return;
  std::ostringstream text;
  text << "reach_mm is " << reach_mm << "; it must be finite and positive.";
  throw InvalidInput(text.str());
}

template <int Dim>
bool is_inside(const ImageGrid<Dim>& grid, const Vector<Dim>& world) {
  const Vector<Dim> index = grid.to_index(world);
  for (int axis = 0; axis < Dim; ++axis)
    if (!(index[axis] >= 0 && index[axis] <= grid.size[axis] - 1)) return false;
  return true;
}

template <int Dim>
bool is_line_inside(const ImageGrid<Dim>& grid, const InterfacePoint<Dim>& point, double reach_mm) {
  return is_inside<Dim>(grid, point.position + reach_mm * point.normal) &&
         is_inside<Dim>(grid, point.position - reach_mm * point.normal);
}

/// u . tangent at `samples` places, evenly from -reach to reach; an even number of steps, so that one is on the
/// interface.
struct Profile {
  std::vector<double> values;
  double step_mm = 0;

  double low() const { return mean(0, third()); }
  double high() const { return mean(values.size() - third(), values.size()); }

 private:
  std::size_t third() const { return values.size() / 6 + 1; }
  double mean(std::size_t begin, std::size_t end) const {
    double sum = 0;
    for (std::size_t k = begin; k < end; ++k) sum += values[k];
    return sum / static_cast<double>(end - begin);
  }
};

template <int Dim>
Profile profile_of(const VectorVolume<Dim>& displacement, const InterfacePoint<Dim>& point, double reach_mm) {
  constexpr double kStepsPerVoxel = 50;
  const double finest = displacement.grid.spacing.minCoeff();
  const int half = std::max(6, static_cast<int>(std::ceil(reach_mm / finest * kStepsPerVoxel)));
  Profile profile;
  profile.step_mm = reach_mm / half;
  for (int k = -half; k <= half; ++k)
    profile.values.push_back(
        displacement_at<Dim>(displacement, point.position + k * profile.step_mm * point.normal).dot(point.tangent));
  return profile;
}

/// Distance between the places of 10 % and 90 %, or none where the profile does not rise from level to level.
std::optional<double> width_of(const Profile& profile) {
  const double low = profile.low(), jump = profile.high() - low;
  if (!(jump > 0)) return {};
  const auto share = [&](std::size_t k) { return (profile.values[k] - low) / jump; };
  // Where the line between samples k and k + 1 reaches `level`, in steps.
  const auto place = [&](std::size_t k, double level) {
    return static_cast<double>(k) + (level - share(k)) / (share(k + 1) - share(k));
  };
  const std::size_t count = profile.values.size();
  const double middle = 0.5 * static_cast<double>(count - 1);
  std::optional<std::size_t> half;
  for (std::size_t k = 0; k + 1 < count; ++k) {
    if (!(share(k) < 0.5 && share(k + 1) >= 0.5)) continue;
    if (!half || std::abs(place(k, 0.5) - middle) < std::abs(place(*half, 0.5) - middle)) half = k;
  }
  if (!half) return {};
  std::size_t up = *half, down = *half;
  while (up + 1 < count && !(share(up + 1) >= 0.9)) ++up;
  while (down > 0 && !(share(down) <= 0.1)) --down;
  if (up + 1 == count || !(share(down) <= 0.1)) return {};
  return (place(up, 0.9) - place(down, 0.1)) * profile.step_mm;
}

}  // namespace

template <int Dim>
TransitionWidth transition_width(const VectorVolume<Dim>& displacement, const std::vector<InterfacePoint<Dim>>& points,
                                 double reach_mm) {
  require_reach(reach_mm);
  TransitionWidth found;
  std::vector<double> widths, jumps;
  for (const InterfacePoint<Dim>& point : points) {
    if (!is_line_inside(displacement.grid, point, reach_mm)) continue;
    const Profile profile = profile_of(displacement, point, reach_mm);
    jumps.push_back(profile.high() - profile.low());
    if (const auto width = width_of(profile)) widths.push_back(*width);
  }
  found.points = jumps.size();
  found.resolved = widths.size();
  found.width_mm = summarise(std::move(widths)).median;
  found.jump_mm = summarise(std::move(jumps)).median;
  return found;
}

template <int Dim>
NormalJump normal_jump(const VectorVolume<Dim>& displacement, const VectorVolume<Dim>& truth,
                       const std::vector<InterfacePoint<Dim>>& points, double reach_mm) {
  require_reach(reach_mm);
  require_same_grid("the displacement", displacement.grid, "the truth", truth.grid);
  NormalJump found;
  for (const InterfacePoint<Dim>& point : points) {
    if (!is_line_inside(displacement.grid, point, reach_mm)) continue;
    const auto error_at = [&](double r) {
      const Vector<Dim> x = point.position + r * point.normal;
      return (displacement_at<Dim>(displacement, x) - displacement_at<Dim>(truth, x)).dot(point.normal);
    };
    const double jump = error_at(reach_mm) - error_at(-reach_mm);
    found.opening_mm += std::max(0.0, jump);
    found.closing_mm += std::max(0.0, -jump);
    ++found.points;
  }
  if (found.points > 0) {
    found.opening_mm /= static_cast<double>(found.points);
    found.closing_mm /= static_cast<double>(found.points);
  }
  return found;
}

#define SALTUS_INSTANTIATE(Dim)                                                                                \
  template TransitionWidth transition_width(const VectorVolume<Dim>&, const std::vector<InterfacePoint<Dim>>&, \
                                            double);                                                           \
  template NormalJump normal_jump(const VectorVolume<Dim>&, const VectorVolume<Dim>&,                          \
                                  const std::vector<InterfacePoint<Dim>>&, double);
SALTUS_INSTANTIATE(2)
SALTUS_INSTANTIATE(3)

}  // namespace saltus
