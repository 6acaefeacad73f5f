// Every similarity, with its default weights, against the truth of a phantom. Those that do not see a contrast turned
// over get a moving image that is dark where the fixed one is bright, in other units and not linearly.
#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "core/phantom/make_phantom.h"
#include "core/registration/register_images.h"
#include "tests/support/phantom_pair.h"

namespace saltus {
namespace {

bool sees_contrast(SimilarityType similarity) {
  switch (similarity) {
    case SimilarityType::Ssd:
    case SimilarityType::Ncc:
    case SimilarityType::Lncc:
      return true;
    case SimilarityType::Mi:
    case SimilarityType::Ngf:
    case SimilarityType::Mind:
      return false;
  }
  throw std::logic_error("a similarity of which nobody said what it sees");
}

/// Mean endpoint error, mm, where errors count; null: of no motion at all.
template <int Dim>
double endpoint_error(const Phantom<Dim>& phantom, const VectorVolume<Dim>* found) {
  double sum = 0, count = 0;
  for (std::size_t i = 0; i < phantom.fixed.samples.size(); ++i) {
    if (phantom.masks.valid.samples[i] == 0) continue;
    double squares = 0;
    for (int c = 0; c < Dim; ++c)
      squares += std::pow((found ? found->component(c)[i] : 0.0) - phantom.displacement.component(c)[i], 2);
    sum += std::sqrt(squares);
    ++count;
  }
  return sum / count;
}

template <int Dim>
void expect_registered(const PhantomOptions& scene, SimilarityType similarity, Model model, double factor) {
  SCOPED_TRACE(to_string(scene.kind) + " " + to_string(model));
  const Phantom<Dim> phantom = make_phantom<Dim>(scene);
  RegistrationInput<Dim> input = testing::pair_of(phantom);
  if (!sees_contrast(similarity))
    for (float& v : input.moving.samples) v = 1000 - 50 * v * v;
  RegistrationOptions options = default_options(model, similarity, Preset::Balanced);
  // At rest and on the voxels themselves the noise is sharper than wherever it is interpolated, which holds ngf and
  // mind there: there must be a coarser level, also for a small volume.
  if (Dim == 3) options.pyramid.levels = 2;
  options.pyramid.finest_level = 0;
  options.optimisation.max_iterations = 40;
  const RegistrationResult<Dim> result = register_images<Dim>(input, options);
  EXPECT_LT(endpoint_error(phantom, &result.displacement), endpoint_error<Dim>(phantom, nullptr) / factor);
  EXPECT_LT(result.summary.similarity_after, result.summary.similarity_before);
  EXPECT_LT(result.summary.share_jacobian_not_positive, 0.01);
}

class RegisterBySimilarity : public ::testing::TestWithParam<SimilarityType> {};

TEST_P(RegisterBySimilarity, FindsASmoothMotion) {
  PhantomOptions scene = default_phantom_options(PhantomKind::Smooth);
  scene.size = {64, 64, 1};
  scene.displacement_mm = 6;
  expect_registered<2>(scene, GetParam(), Model::Gaussian, 4);
}

TEST_P(RegisterBySimilarity, FindsASlip) {
  PhantomOptions scene = default_phantom_options(PhantomKind::Slip);
  scene.size = {72, 72, 1};
  expect_registered<2>(scene, GetParam(), Model::Sliding, 3);
}

TEST_P(RegisterBySimilarity, FindsASmoothMotionInThreeDimensions) {
  PhantomOptions scene = default_phantom_options(PhantomKind::Smooth, 3);
  scene.size = {28, 26, 24};
  scene.displacement_mm = 3;
  expect_registered<3>(scene, GetParam(), Model::Gaussian, 2);
}

INSTANTIATE_TEST_SUITE_P(Similarities, RegisterBySimilarity, ::testing::ValuesIn(all_similarities()),
                         [](const auto& info) { return to_string(info.param); });

}  // namespace
}  // namespace saltus
