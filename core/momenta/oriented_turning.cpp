#include "core/momenta/oriented_momenta.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>

// Which elements are turned, and from which of the options' normals.

namespace saltus {
namespace {

/// How far elements are turned from a normal that others are turned from as well, degrees: so far that an interface
/// which is nearly plane has one, wherever between the normals it lies.
constexpr double kSharedTurn = 36;
/// What the steepest axis of a normal has to be of what is turned from it: elements are laid out along the others.
constexpr double kLeastSteepness = 0.4;
/// What an element that has a momentum counts for when normals are chosen, in sites that have none.
constexpr double kActiveVotes = 20;
/// Elements with a momentum keep their turn where they would be this far from their normal, degrees.
constexpr double kFarthestTurn = 60;

}  // namespace

template <int Dim, class T>
bool OrientedMomenta<Dim, T>::has_room(Element element) const {
  std::size_t rest = site_of(element);
  for (int a = 0; a < Dim; ++a) {
    const auto length = static_cast<std::size_t>(options_.lattice.size[a]);
    if (a != steepest_axis(normal_of(element)) && rest % length % static_cast<std::size_t>(apart_[a]) != 0)
      return false;
    rest /= length;
  }
  return true;
}

template <int Dim, class T>
void OrientedMomenta<Dim, T>::turn(std::vector<T> normals, const std::vector<Element>& active) {
  if (normals.empty()) return restore_turned({}, {});
  using Normal = Eigen::Matrix<T, Dim, 1>;
  const auto normal_at = [&](std::size_t site) { return Eigen::Map<Normal>(normals.data() + Dim * site); };
  const auto along = [&](std::size_t site, std::size_t k) {
    return normal_at(site).template cast<double>().dot(options_.normals[k]);
  };
  const double near = std::cos(kSharedTurn * std::numbers::pi / 180),
               least = std::cos(kFarthestTurn * std::numbers::pi / 180);
  const auto is_steep = [&](std::size_t site, std::size_t k) {
    const auto steepness = [&](int a) { return std::abs(normal_at(site)[a]) * options_.lattice.spacing[a]; };
    for (int a = 0; a < Dim; ++a)
      if (steepness(orientations_[k].steepest) < kLeastSteepness * steepness(a)) return false;
    return true;
  };
  const auto is_near = [&](std::size_t site, std::size_t k) {
    return std::abs(along(site, k)) >= near && is_steep(site, k);
  };
  std::vector<Element> turned;
  std::vector<double> active_votes(orientations_.size());
  std::vector<char> is_done(sites_, 0);
  const auto turn_from = [&](std::size_t site, std::size_t k) {
    if (along(site, k) < 0) normal_at(site) *= T(-1);
    turned.push_back(static_cast<Element>(k * sites_ + site));
    is_done[site] = 1;
  };
  for (Element element : active) {
    const std::size_t site = site_of(element), k = normal_of(element);
    if (!std::binary_search(turned_.begin(), turned_.end(), element) || is_done[site]) continue;
    const Eigen::Map<Normal> before(turned_normals_.data() + Dim * site);
    const double turn = std::abs(normal_at(site).dot(before));
    if (!(turn >= near && std::abs(along(site, k)) >= least)) normal_at(site) = before;
    turn_from(site, k);
    active_votes[k] += kActiveVotes;
  }
  std::vector<std::size_t> open;
  for (std::size_t site = 0; site < sites_; ++site)
    if (!is_done[site] && normal_at(site).squaredNorm() > T(0)) open.push_back(site);
  // Normals that are near to most of what is left, one after the other.
  std::vector<double> votes(orientations_.size());
  while (!open.empty()) {
    std::fill(votes.begin(), votes.end(), 0.0);
    for (std::size_t site : open)
      for (std::size_t k = 0; k < votes.size(); ++k)
        if (is_near(site, k)) votes[k] += std::pow(along(site, k), 2);
    for (std::size_t k = 0; k < votes.size(); ++k)
      if (votes[k] > 0) votes[k] += active_votes[k];
    const auto most = std::max_element(votes.begin(), votes.end());
    if (*most == 0) break;
    const auto best = static_cast<std::size_t>(most - votes.begin());
    std::erase_if(open, [&](std::size_t site) {
      const bool joins = is_near(site, best);
      if (joins) turn_from(site, best);
      return joins;
    });
  }
  for (std::size_t site : open) {  // the nearest one that is steep enough; the axes are among the normals
    std::size_t nearest = 0;
    double most = -1;
    for (std::size_t k = 0; k < votes.size(); ++k)
      if (const double c = std::abs(along(site, k)); c > most && is_steep(site, k)) {
        most = c;
        nearest = k;
      }
    turn_from(site, nearest);
  }
  std::sort(turned.begin(), turned.end());
  restore_turned(std::move(normals), std::move(turned));
}

template <int Dim, class T>
void OrientedMomenta<Dim, T>::restore_turned(std::vector<T> normals, std::vector<Element> turned) {
  ++turns_;
  turned_normals_ = std::move(normals);
  turned_ = std::move(turned);
  candidates_.clear();
  std::copy_if(turned_.begin(), turned_.end(), std::back_inserter(candidates_), [&](Element e) { return has_room(e); });
}

template void OrientedMomenta<2, float>::turn(std::vector<float>, const std::vector<Element>&);
template void OrientedMomenta<2, float>::restore_turned(std::vector<float>, std::vector<Element>);
template void OrientedMomenta<3, float>::turn(std::vector<float>, const std::vector<Element>&);
template void OrientedMomenta<3, float>::restore_turned(std::vector<float>, std::vector<Element>);
template void OrientedMomenta<2, double>::turn(std::vector<double>, const std::vector<Element>&);
template void OrientedMomenta<2, double>::restore_turned(std::vector<double>, std::vector<Element>);
template void OrientedMomenta<3, double>::turn(std::vector<double>, const std::vector<Element>&);
template void OrientedMomenta<3, double>::restore_turned(std::vector<double>, std::vector<Element>);

}  // namespace saltus
