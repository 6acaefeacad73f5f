#include "server/worker/task_inputs.h"

#include "core/grid/crop.h"
#include "core/grid/intensity_window.h"
#include "core/image_io/points_io.h"
#include "core/image_io/read_image.h"
#include "core/support/errors.h"
#include "server/worker/attempt.h"

#include <algorithm>
#include <cmath>
#include <sstream>

namespace saltus::worker {
namespace {

namespace fs = std::filesystem;

template <int Dim>
std::string describe(const ImageGrid<Dim>& grid) {
  std::ostringstream text;
  for (int axis = 0; axis < Dim; ++axis) text << (axis ? "x" : "") << grid.size[axis];
  text << " voxels of ";
  for (int axis = 0; axis < Dim; ++axis) text << (axis ? "x" : "") << grid.spacing[axis];
  text << " mm from (";
  for (int axis = 0; axis < Dim; ++axis) text << (axis ? ", " : "") << grid.origin[axis];
  text << ")";
  return text.str();
}

/// True when voxel centres are the same to a hundredth of a voxel, which is more than formats lose by rounding.
template <int Dim>
bool is_same_place(const ImageGrid<Dim>& a, const ImageGrid<Dim>& b) {
  if (a.size != b.size) return false;
  for (int corner = 0; corner < (1 << Dim); ++corner) {
    Vector<Dim> index;
    for (int axis = 0; axis < Dim; ++axis) index[axis] = (corner >> axis & 1) ? a.size[axis] - 1 : 0;
    if ((a.to_index(b.to_world(index)) - index).cwiseAbs().maxCoeff() > 0.01) return false;
  }
  return true;
}

template <int Dim>
void require_finite(const Volume<Dim>& image, const std::string& name) {
  const auto is_bad = [](float value) { return !std::isfinite(value); };
  const auto first = std::find_if(image.samples.begin(), image.samples.end(), is_bad);
  if (first == image.samples.end()) return;
  std::ostringstream text;
  text << "the " << name << " image has " << std::count_if(first, image.samples.end(), is_bad)
       << " voxels that are not finite numbers, the first at (";
  std::size_t rest = static_cast<std::size_t>(first - image.samples.begin());
  for (int axis = 0; axis < Dim; ++axis) {
    text << (axis ? ", " : "") << rest % image.grid.size[axis];
    rest /= image.grid.size[axis];
  }
  text << "); give them a value, and a mask if that value means nothing";
  throw TaskFailure("NON_FINITE_INPUT", text.str());
}

/// A mask must lie on its image's grid; it then gets exactly that grid.
template <int Dim>
Volume<Dim> read_mask(const fs::path& file, const ImageGrid<Dim>& grid, const std::string& name) {
  Volume<Dim> mask = read_volume<Dim>(file);
  if (!is_same_place(grid, mask.grid))
    throw TaskFailure("GEOMETRY_MISMATCH", "the " + name + " mask has " + describe(mask.grid) + " and the " + name +
                                               " image " + describe(grid) + "; resample the mask to the image's grid");
  mask.grid = grid;
  return mask;
}

template <int Dim>
Landmarks<Dim> read_landmarks(const RegistrationTask& task) {
  if (!task.fixed_points || !task.moving_points) return {};
  Landmarks<Dim> points{read_points<Dim>(*task.fixed_points), read_points<Dim>(*task.moving_points)};
  if (points.fixed.size() != points.moving.size())
    throw TaskFailure("GEOMETRY_MISMATCH", "there are " + std::to_string(points.fixed.size()) + " fixed and " +
                                               std::to_string(points.moving.size()) +
                                               " moving landmarks; they are matched row by row");
  return points;
}

template <int Dim>
Index<Dim> to_index(const std::vector<int>& values) {
  if (values.size() != Dim)
    throw InvalidInput("the crop box has " + std::to_string(values.size()) + " coordinates a corner and the images " +
                       std::to_string(Dim) + " dimensions; give one coordinate for each");
  Index<Dim> index{};
  std::copy(values.begin(), values.end(), index.begin());
  return index;
}

template <int Dim>
void prepare(RegistrationInput<Dim>& input, const RegistrationTask& task) {
  if (task.intensity_window) {
    const auto low = static_cast<float>(task.intensity_window->first);
    const auto high = static_cast<float>(task.intensity_window->second);
    input.fixed = clip_intensities(input.fixed, low, high);
    input.moving = clip_intensities(input.moving, low, high);
  }
  if (task.crop) {
    const Index<Dim> begin = to_index<Dim>(task.crop->begin), end = to_index<Dim>(task.crop->end);
    input.fixed = crop(input.fixed, begin, end);
    if (input.fixed_mask) input.fixed_mask = crop(*input.fixed_mask, begin, end);
  }
}

}  // namespace

RegistrationOptions make_options(const RegistrationTask& task) {
  RegistrationOptions options =
      default_options(task.model.empty() ? RegistrationOptions{}.model : parse_model(task.model),
                      task.similarity.empty() ? RegistrationOptions{}.similarity : parse_similarity(task.similarity),
                      task.preset.empty() ? RegistrationOptions{}.preset : parse_preset(task.preset));
  for (const auto& [name, value] : task.settings) set_parameter(options, name, value);
  options.threads = task.threads;
  if (const auto found = problems(options); !found.empty()) throw InvalidInput(found.front());
  return options;
}

template <int Dim>
TaskInputs<Dim> read_inputs(const RegistrationTask& task) {
  const fs::path folder = task.fixed.parent_path();
  TaskInputs<Dim> inputs;
  RegistrationInput<Dim>& images = inputs.images;
  attempt("INPUT_UNREADABLE", folder, [&] {
    images.fixed = read_volume<Dim>(task.fixed);
    images.moving = read_volume<Dim>(task.moving);
    if (task.fixed_mask) images.fixed_mask = read_mask(*task.fixed_mask, images.fixed.grid, "fixed");
    if (task.moving_mask) images.moving_mask = read_mask(*task.moving_mask, images.moving.grid, "moving");
    inputs.landmarks = read_landmarks<Dim>(task);
  });
  require_finite(images.fixed, "fixed");
  require_finite(images.moving, "moving");
  attempt("INVALID_OPTIONS", folder, [&] { prepare(images, task); });
  return inputs;
}

int input_dimension(const RegistrationTask& task) {
  const auto dimension_of = [&task](const fs::path& file) {
    return attempt("INPUT_UNREADABLE", task.fixed.parent_path(), [&file] { return image_dimension(file); });
  };
  const int fixed = dimension_of(task.fixed), moving = dimension_of(task.moving);
  if (fixed != moving)
    throw TaskFailure("GEOMETRY_MISMATCH", "the fixed image has " + std::to_string(fixed) +
                                               " dimensions and the moving " + std::to_string(moving) +
                                               "; both must have the same");
  return fixed;
}

template TaskInputs<2> read_inputs(const RegistrationTask&);
template TaskInputs<3> read_inputs(const RegistrationTask&);

}  // namespace saltus::worker
