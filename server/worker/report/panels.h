#pragma once

#include "core/drawing/raster.h"
#include "core/drawing/slice_plane.h"

#include <array>
#include <functional>
#include <string>
#include <vector>

namespace saltus::report {

/// Colour bar from left to right with a text at each end and in the middle.
std::string colour_bar(const std::function<drawing::Colour(double)>& colour_at, const std::array<std::string, 3>& texts,
                       const std::string& unit);

/// How figures stand: key pictures of volumes over the whole width, others side by side.
enum class GalleryWidth { Whole, Shared };

/// The slices of an image as HTML: one figure has a caption and a picture for each plane, all of one height.
template <int Dim>
class Panels {
 public:
  using Content = std::function<std::string(const drawing::SlicePlane<Dim>&)>;

  explicit Panels(std::vector<drawing::SlicePlane<Dim>> planes) : planes_(std::move(planes)) {}

  const std::vector<drawing::SlicePlane<Dim>>& planes() const { return planes_; }

  /// `below` stands under the pictures.
  std::string figure(const std::string& title, const std::string& explanation, const Content& content,
                     const std::string& below = "") const;
  static std::string gallery(const std::vector<std::string>& figures, GalleryWidth width);
  static std::string image(const drawing::SlicePlane<Dim>& plane, const drawing::Raster& raster,
                           const std::string& what);
  /// The same of a picture of the plane as its data_uri.
  static std::string image(const drawing::SlicePlane<Dim>& plane, const std::string& uri, const std::string& what);
  /// An <svg> over a picture, in picture pixels.
  static std::string overlay(const drawing::SlicePlane<Dim>& plane, const std::string& kind, const std::string& paths);
  /// Orientation letters at the four sides.
  static std::string side_labels(const drawing::SlicePlane<Dim>& plane);

 private:
  std::vector<drawing::SlicePlane<Dim>> planes_;
};

}  // namespace saltus::report
