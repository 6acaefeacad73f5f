#include "server/worker/report/interface.h"

#include "core/drawing/markup.h"

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <array>
#include <cmath>
#include <unordered_map>

namespace saltus::report {
namespace {

constexpr double least_share_of_motion = 0.2;
constexpr double least_share_of_spacing = 0.25;
// What the slopes leave unexplained, of the change itself: 1 at a jump, 0.5 where a voxel between the sides is half of
// each, 1.1 / s^2 in the middle of a Gaussian flank of s voxels.
constexpr double least_sharpness = 0.4;
constexpr int neighbourhood = 2;  // voxels around a face that tell its normal
// Of the faces that a flat interface has within the neighbourhood, (2 * neighbourhood + 1)^(Dim-1).
constexpr double least_share_of_patch = 0.3;
constexpr double least_coherence = 0.6;  // |sum of |j| j| / sum of |j|^2 over the jumps j around
constexpr double least_alignment = 0.7;  // cosine between a face's jump and that sum

template <int Dim>
class Detector {
 public:
  explicit Detector(const VectorVolume<Dim>& u) : grid_(u.grid) {
    std::size_t stride = 1;
    for (int axis = 0; axis < Dim; ++axis) {
      u_[axis] = u.component(axis);
      strides_[axis] = stride;
      stride *= static_cast<std::size_t>(grid_.size[axis]);
    }
  }

  DetectedInterface<Dim> operator()() {
    found_.threshold_mm =
        std::max(least_share_of_motion * typical_motion(), least_share_of_spacing * grid_.spacing.minCoeff());
    collect();
    index_faces();
    for (InterfaceFace<Dim>& face : found_.faces) split_jump(face);
    drop_the_scattered();
    summarise_faces();
    return std::move(found_);
  }

 private:
  Vector<Dim> at(std::size_t voxel) const {
    Vector<Dim> value;
    for (int c = 0; c < Dim; ++c) value[c] = u_[c][voxel];
    return value;
  }

  double typical_motion() const {
    const std::size_t voxels = grid_.voxels(), step = voxels / 200'000 + 1;
    std::vector<double> lengths;
    for (std::size_t voxel = 0; voxel < voxels; voxel += step) lengths.push_back(at(voxel).norm());
    return quantile_of(lengths, 0.99);
  }

  /// u across the face behind `voxel`.
  Vector<Dim> change(std::size_t voxel, std::size_t stride) const { return at(voxel + stride) - at(voxel); }

  /// The faces by axis, and for each by voxel.
  void collect() {
    const int slabs = grid_.size[Dim - 1], rows = Dim == 3 ? grid_.size[1] : 1;
    std::vector<std::array<std::vector<InterfaceFace<Dim>>, Dim>> faces(static_cast<std::size_t>(slabs));
#pragma omp parallel
    {
      std::vector<float> squares(static_cast<std::size_t>(grid_.size[0]));
#pragma omp for schedule(static)
      for (int slab = 0; slab < slabs; ++slab)
        for (int row = 0; row < rows; ++row)
          for (int axis = 0; axis < Dim; ++axis) {
            Index<Dim> first{};
            first[1] = row;
            first[Dim - 1] = slab;
            collect_row(first, axis, squares, faces[static_cast<std::size_t>(slab)][axis]);
          }
    }
    for (int axis = 0; axis < Dim; ++axis)
      for (const auto& of_slab : faces)
        found_.faces.insert(found_.faces.end(), of_slab[axis].begin(), of_slab[axis].end());
  }

  void collect_row(Index<Dim> index, int axis, std::vector<float>& squares,
                   std::vector<InterfaceFace<Dim>>& faces) const {
    const auto is_within = [&](int i) { return i >= 2 && i + 3 < grid_.size[axis]; };
    if (axis > 0 && !is_within(index[axis])) return;
    const std::size_t row = number_of(index), stride = strides_[axis];
    const int begin = axis == 0 ? 2 : 0, end = axis == 0 ? grid_.size[0] - 3 : grid_.size[0];
    for (int x = begin; x < end; ++x) squares[static_cast<std::size_t>(x)] = 0;
    for (const float* u : u_) {
      const float* here = u + row;
      const float* next = here + stride;
      for (int x = begin; x < end; ++x) squares[x] += (next[x] - here[x]) * (next[x] - here[x]);
    }
    // Most voxels end here; what single precision could have lost is left to the test below.
    const auto least = static_cast<float>(0.999 * std::pow(found_.threshold_mm / 2, 2));
    for (int x = begin; x < end; ++x) {
      if (squares[x] < least) continue;
      index[0] = x;
      const std::size_t voxel = row + static_cast<std::size_t>(x);
      const Vector<Dim> here = change(voxel, stride);
      if (here.norm() >= found_.threshold_mm / 2) consider(voxel, index, axis, here, faces);
    }
  }

  void consider(std::size_t voxel, const Index<Dim>& index, int axis, const Vector<Dim>& here,
                std::vector<InterfaceFace<Dim>>& faces) const {
    const std::size_t stride = strides_[axis];
    const double size = here.norm();
    const double before = change(voxel - stride, stride).norm(), after = change(voxel + stride, stride).norm();
    if (size < before || size <= after) return;
    // A jump two faces away would be taken for a slope below.
    if (std::max(change(voxel - 2 * stride, stride).norm(), change(voxel + 2 * stride, stride).norm()) > size) return;
    const Vector<Dim> near_slopes = (change(voxel - stride, stride) + change(voxel + stride, stride)) / 2;
    if ((here - near_slopes).norm() < least_sharpness * size) return;
    const Vector<Dim> far_slopes = (change(voxel - 2 * stride, stride) + change(voxel + 2 * stride, stride)) / 2;
    const Vector<Dim> jump = at(voxel + 2 * stride) - at(voxel - stride) - 3 * far_slopes;
    if (jump.norm() < found_.threshold_mm) return;
    InterfaceFace<Dim> face;
    face.voxel = index;
    face.axis = axis;
    face.jump = jump;
    faces.push_back(face);
  }

  std::size_t number_of(const Index<Dim>& index) const {
    std::size_t voxel = 0;
    for (int axis = 0; axis < Dim; ++axis) voxel += strides_[axis] * static_cast<std::size_t>(index[axis]);
    return voxel;
  }

  void index_faces() {
    faces_at_.clear();
    for (std::size_t i = 0; i < found_.faces.size(); ++i) faces_at_.emplace(number_of(found_.faces[i].voxel), i);
  }

  template <class Visit>
  void for_each_near(const InterfaceFace<Dim>& face, const Visit& visit) const {
    Index<Dim> index{}, first{}, last{};
    for (int axis = 0; axis < Dim; ++axis) {
      first[axis] = std::max(0, face.voxel[axis] - neighbourhood);
      last[axis] = std::min(grid_.size[axis] - 1, face.voxel[axis] + neighbourhood);
    }
    for (index = first;;) {
      const auto [begin, end] = faces_at_.equal_range(number_of(index));
      for (auto it = begin; it != end; ++it) visit(found_.faces[it->second]);
      int axis = 0;
      while (axis < Dim && index[axis]++ == last[axis]) index[axis] = first[axis], ++axis;
      if (axis == Dim) return;
    }
  }

  void split_jump(InterfaceFace<Dim>& face) const {
    const Vector<Dim> axis_normal = grid_.direction.col(face.axis);
    face.normal = fitted_normal(face);
    const double across = face.normal.dot(axis_normal);
    if (across < 0) face.normal = -face.normal;
    face.opening_mm = face.jump.dot(face.normal);
    face.slip_mm = (face.jump - face.opening_mm * face.normal).norm();
    face.extent = grid_.voxel_volume() / grid_.spacing[face.axis] * std::abs(across);
  }

  /// Direction in which the faces around scatter least; that of the axis when they are too few to tell.
  Vector<Dim> fitted_normal(const InterfaceFace<Dim>& face) const {
    Vector<Dim> mean = Vector<Dim>::Zero();
    Matrix<Dim> squares = Matrix<Dim>::Zero();
    int count = 0;
    double weights = 0;
    for_each_near(face, [&](const InterfaceFace<Dim>& near) {
      // A large jump says more about where the interface runs than the noise beside it.
      const double weight = near.jump.squaredNorm();
      const Vector<Dim> place = grid_.to_world(near.middle()) - grid_.to_world(face.middle());
      mean += weight * place;
      squares += weight * place * place.transpose();
      weights += weight;
      ++count;
    });
    const Vector<Dim> axis_normal = grid_.direction.col(face.axis);
    if (count < 2 * Dim) return axis_normal;
    mean /= weights;
    const Eigen::SelfAdjointEigenSolver<Matrix<Dim>> solver(squares / weights - mean * mean.transpose());
    const Vector<Dim> normal = solver.eigenvectors().col(0);
    // A face along the interface is a step of it at most; what is steeper is another sheet that passes by.
    return std::abs(normal.dot(axis_normal)) < 0.2 ? axis_normal : normal;
  }

  struct Surroundings {
    int count = 0;
    Vector<Dim> sum = Vector<Dim>::Zero();  ///< of |j| j times its extent, each counted along the face's normal
    double squares = 0;                     ///< of |j|^2 times its extent
  };
  Surroundings surroundings(const InterfaceFace<Dim>& face) const {
    Surroundings around;
    for_each_near(face, [&](const InterfaceFace<Dim>& near) {
      ++around.count;
      const double sign = near.normal.dot(face.normal) < 0 ? -1 : 1, size = near.jump.norm();
      around.sum += sign * near.extent * size * near.jump;
      around.squares += near.extent * size * size;
    });
    return around;
  }

  void drop_the_scattered() {
    const double patch = std::pow(2 * neighbourhood + 1, Dim - 1);
    std::vector<InterfaceFace<Dim>> kept;
    for (const InterfaceFace<Dim>& face : found_.faces) {
      // A normal that was fitted may turn most of a jump into an opening.
      if (face.slip_mm < found_.threshold_mm) continue;
      const Surroundings around = surroundings(face);
      if (around.count < least_share_of_patch * patch) continue;
      if (around.sum.norm() < least_coherence * around.squares) continue;
      if (around.sum.dot(face.jump) >= least_alignment * around.sum.norm() * face.jump.norm()) kept.push_back(face);
    }
    found_.faces = std::move(kept);
    index_faces();
  }

  void summarise_faces() {
    std::vector<double> slips, gaps;
    double most = 0;
    for (const InterfaceFace<Dim>& face : found_.faces) {
      slips.push_back(face.slip_mm);
      gaps.push_back(std::abs(face.opening_mm));
      found_.extent += face.extent;
      if (const double around = surroundings(face).sum.norm(); around > most) {
        most = around;
        found_.strongest = face.middle();
      }
    }
    found_.slip_mm = summarise(slips);
    found_.gap_mm = summarise(gaps);
  }

  const ImageGrid<Dim>& grid_;
  std::array<const float*, Dim> u_{};  // by component
  std::array<std::size_t, Dim> strides_{};
  DetectedInterface<Dim> found_;
  std::unordered_multimap<std::size_t, std::size_t> faces_at_;  // by voxel
};

}  // namespace

template <int Dim>
Vector<Dim> InterfaceFace<Dim>::middle() const {
  Vector<Dim> index;
  for (int a = 0; a < Dim; ++a) index[a] = voxel[a] + (a == axis ? 0.5 : 0.0);
  return index;
}

template <int Dim>
DetectedInterface<Dim> detect_interface(const VectorVolume<Dim>& displacement) {
  return Detector<Dim>(displacement)();
}

template <int Dim>
std::string extent_text(const DetectedInterface<Dim>& interface) {
  if (Dim == 2) return drawing::number(interface.extent) + " mm";
  return interface.extent >= 100 ? drawing::number(interface.extent / 100) + " cm\u00b2"
                                 : drawing::number(interface.extent) + " mm\u00b2";
}

template std::string extent_text(const DetectedInterface<2>&);
template std::string extent_text(const DetectedInterface<3>&);
template struct InterfaceFace<2>;
template struct InterfaceFace<3>;
template DetectedInterface<2> detect_interface(const VectorVolume<2>&);
template DetectedInterface<3> detect_interface(const VectorVolume<3>&);

}  // namespace saltus::report
