// Oracle: every block that operator new gives while register_images runs, counted; all fields of the core come from it.
#include "core/phantom/make_phantom.h"
#include "core/registration/register_images.h"
#include "core/registration/scales.h"

#include <gtest/gtest.h>

#include <malloc.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <new>

namespace {

std::atomic<std::ptrdiff_t> bytes_in_use{0}, most_bytes{0};

void* counted(void* block) {
  if (block == nullptr) throw std::bad_alloc();
  const std::ptrdiff_t now = bytes_in_use += static_cast<std::ptrdiff_t>(malloc_usable_size(block));
  std::ptrdiff_t most = most_bytes;
  while (now > most && !most_bytes.compare_exchange_weak(most, now)) {
  }
  return block;
}

void give_back(void* block) {
  bytes_in_use -= static_cast<std::ptrdiff_t>(malloc_usable_size(block));
  std::free(block);
}

}  // namespace

// The forms that all others call.
void* operator new(std::size_t size) { return counted(std::malloc(std::max<std::size_t>(size, 1))); }
void* operator new(std::size_t size, std::align_val_t alignment) {
  const auto step = static_cast<std::size_t>(alignment);
  return counted(std::aligned_alloc(step, (size + step - 1) / step * step));
}
void operator delete(void* block) noexcept { give_back(block); }
void operator delete(void* block, std::size_t) noexcept { give_back(block); }
void operator delete(void* block, std::align_val_t) noexcept { give_back(block); }
void operator delete(void* block, std::size_t, std::align_val_t) noexcept { give_back(block); }

namespace saltus {
namespace {

constexpr double mib = 1024.0 * 1024.0;
// What the estimate adds for the program itself, which is not what is counted here.
constexpr double program_mib = 64;

struct Case {
  RegistrationInput<3> input;
  RegistrationOptions options;

  explicit Case(Model model, SimilarityType similarity = SimilarityType::Lncc, Preset preset = Preset::Balanced,
                int finer = 1)
      : options(default_options(model, similarity, preset)) {
    PhantomOptions scene = default_phantom_options(PhantomKind::Thorax);
    scene.size = {36 * finer, 36 * finer, 32 * finer};
    scene.spacing = {6.0 / finer, 6.0 / finer, 6.0 / finer};
    Phantom<3> phantom = make_phantom<3>(scene);
    input.fixed = std::move(phantom.fixed);
    input.moving = std::move(phantom.moving);
    options.optimisation.max_iterations = 3;
    options.threads = 1;
  }

  /// As many iterations as L-BFGS has pairs, and some.
  void fill_pairs() {
    options.optimisation.max_iterations = resolved(options, lattice_of(input.fixed.grid)).optimisation.history + 5;
  }

  /// All that may be given.
  void add_masks() {
    input.fixed_mask = Volume<3>(input.fixed.grid, 1.0f);
    input.moving_mask = Volume<3>(input.moving.grid, 1.0f);
    const auto plane = static_cast<std::size_t>(input.fixed.grid.size[0] * input.fixed.grid.size[1]);
    for (std::size_t i = 0; i < plane; ++i) input.fixed_mask->samples[i] = input.moving_mask->samples[i] = 0;
  }

  double declared_mib() const {
    return static_cast<double>(memory_estimate<3>(input.fixed.grid, input.moving.grid, options)) / mib - program_mib;
  }

  /// Largest sum of what was held at the same time. What is given counts. Fills in what the last level says, where
  /// asked.
  double used_mib(LevelSummary* finest = nullptr) const {
    std::size_t given = input.fixed.samples.size() + input.moving.samples.size();
    for (const auto* mask : {&input.fixed_mask, &input.moving_mask})
      if (*mask) given += (*mask)->samples.size();
    if (input.direction) given += input.direction->samples.size();
    const double images = static_cast<double>(given) * sizeof(float);
    const std::ptrdiff_t before = bytes_in_use;
    most_bytes = before;
    const RegistrationResult<3> result = register_images<3>(input, options);
    if (finest) *finest = result.summary.levels.back();
    return (static_cast<double>(most_bytes - before) + images) / mib;
  }
};

TEST(MemoryEstimate, IsABoundForEachModel) {
  for (Model model : {Model::Gaussian, Model::Wendland, Model::Wendland1, Model::Sliding, Model::Auto}) {
    Case one(model);
    EXPECT_LE(one.used_mib(), one.declared_mib()) << to_string(model);
    one.add_masks();
    EXPECT_LE(one.used_mib(), one.declared_mib()) << to_string(model) << ", with masks";
  }
  Case directional(Model::Directional);
  directional.add_masks();
  directional.input.direction = VectorVolume<3>(directional.input.fixed.grid);
  std::fill_n(directional.input.direction->component(0), directional.input.fixed.grid.voxels(), 1.0f);
  EXPECT_LE(directional.used_mib(), directional.declared_mib());
}

// Beside the weights of a mask that rests come the slopes of the warped image, where the flow is coarser.
TEST(MemoryEstimate, IsABoundWithAMaskOnTheFixedImageAlone) {
  // So large that a field that is forgotten is more than what is counted for each thread, whatever the size.
  Case one(Model::Gaussian, SimilarityType::Lncc, Preset::Balanced, 3);
  one.add_masks();
  one.input.moving_mask.reset();
  one.options.flow.time_steps = 6;  // so that what a round holds is the most
  EXPECT_LE(one.used_mib(), one.declared_mib());
}

TEST(MemoryEstimate, IsABoundForEachSimilarity) {
  for (SimilarityType similarity :
       {SimilarityType::Ssd, SimilarityType::Ncc, SimilarityType::Mi, SimilarityType::Ngf, SimilarityType::Mind}) {
    Case one(Model::Sliding, similarity);
    one.add_masks();
    EXPECT_LE(one.used_mib(), one.declared_mib()) << to_string(similarity);
  }
}

// Of a size at which six of its 48 fields that are forgotten are more than what is counted to be safe.
TEST(MemoryEstimate, IsABoundForSelfSimilarityWithMasks) {
  Case one(Model::Gaussian, SimilarityType::Mind, Preset::Balanced, 3);
  one.add_masks();
  EXPECT_LE(one.used_mib(), one.declared_mib());
}

TEST(MemoryEstimate, IsABoundForEachPreset) {
  for (Preset preset : {Preset::Fast, Preset::Accurate}) {
    const Case one(Model::Sliding, SimilarityType::Lncc, preset);
    EXPECT_LE(one.used_mib(), one.declared_mib()) << to_string(preset);
  }
}

// Where images are as fine as they come, and first orders, let in unasked, and the flow twice as coarse.
TEST(MemoryEstimate, IsABoundWhereTheFlowIsCoarserBesideFirstOrders) {
  Case one(Model::Auto, SimilarityType::Lncc, Preset::Accurate, 4);
  one.options.momenta.first_order_shear = 0;
  one.options.momenta.plain_shear = one.options.momenta.settled_plain_shear = one.options.momenta.narrower_pull = 0;
  one.options.momenta.quick_share = one.options.momenta.quick_tolerance = one.options.momenta.finer_shear = 0;
  const Lattice<3> image = lattice_of(one.input.fixed.grid);
  const RegistrationOptions options = resolved(one.options, image);
  ASSERT_EQ(flow_lattice_beside_first(image, options, options.pyramid.finest_level), level_lattice(image, 1));
  Case finer = one;
  finer.options.momenta.first_order_finest_scale = 0;
  LevelSummary finest;
  EXPECT_LE(one.used_mib(&finest), one.declared_mib());
  EXPECT_GT(finest.oriented_elements, 0);
  EXPECT_LT(one.declared_mib(), 0.6 * finer.declared_mib());
}

// What jumps is listed once, however many widths a kernel has: a list for each would be more than all else.
TEST(MemoryEstimate, IsABoundForKernelsOfManyWidths) {
  for (Model model : {Model::Wendland1, Model::Directional}) {
    Case one(model, SimilarityType::Ssd);
    one.options.pyramid.finest_level = 0;
    one.options.momenta.sparsity = 0;
    one.options.momenta.finest_scale = one.options.momenta.first_order_finest_scale = 0;
    one.options.momenta.kernel_widths = {{6, 1}, {5, 1}, {4, 1}, {3, 1}};
    if (model == Model::Directional) one.options.momenta.direction = {1, 0, 0};
    EXPECT_LE(one.used_mib(), one.declared_mib()) << to_string(model);
  }
}

// A moving image of many times the fixed one's sites, which is what a crop leaves, and masks on both.
TEST(MemoryEstimate, IsABoundWhereTheMovingImageIsLarger) {
  for (Preset preset : {Preset::Balanced, Preset::Accurate}) {
    Case one(Model::Gaussian, SimilarityType::Ssd, preset, 4);
    const Case small(Model::Gaussian, SimilarityType::Ssd, preset);
    one.input.fixed = small.input.fixed;
    one.add_masks();
    EXPECT_LE(one.used_mib(), one.declared_mib()) << to_string(preset);
  }
}

TEST(MemoryEstimate, IsABoundForManyBins) {
  Case one(Model::Gaussian, SimilarityType::Mi);
  one.options.similarity_parameters.mi_bins = 256;
  EXPECT_LE(one.used_mib(), one.declared_mib());
}

// Oriented momenta at a fifth of the sites and more, beside all blocks: so little sparsity lets them join wherever
// there is a ridge of shear. L-BFGS has all its pairs.
TEST(MemoryEstimate, IsABoundWithManyOrientedMomenta) {
  Case one(Model::Auto, SimilarityType::Lncc);
  one.options.momenta.first_order_shear = 1e-9;
  one.options.momenta.oblique_share = 0;
  one.options.momenta.oriented_alone = 0;
  one.options.momenta.sparsity = 1e-3;
  one.options.momenta.most_active_share = 1;
  one.fill_pairs();
  LevelSummary finest;
  const double used = one.used_mib(&finest);
  EXPECT_GT(finest.active_block_share, 0.9);
  EXPECT_GT(finest.oriented_elements,
            static_cast<int>(one.input.fixed.samples.size() / 5) / 9);  // each stands for nine
  EXPECT_LE(used, one.declared_mib());
}

// The same where there are elements alone, which need no fields.
TEST(MemoryEstimate, IsABoundWhereElementsAreAlone) {
  for (SimilarityType similarity : {SimilarityType::Mi, SimilarityType::Ngf, SimilarityType::Mind}) {
    Case one(Model::Auto, similarity);
    one.options.momenta.first_order_shear = 1e-9;
    one.options.momenta.sparsity = 1e-5;
    one.fill_pairs();
    one.add_masks();
    LevelSummary finest;
    const double used = one.used_mib(&finest);
    EXPECT_GT(finest.oriented_elements, 0) << to_string(similarity);
    EXPECT_LE(used, one.declared_mib()) << to_string(similarity);
  }
  Case one(Model::Auto, SimilarityType::Lncc);
  one.options.momenta.first_order_shear = 1e-9;
  one.options.momenta.sparsity = 1e-3;
  one.fill_pairs();
  Case beside = one;
  beside.options.momenta.oriented_alone = 1;
  EXPECT_LT(one.declared_mib(), 0.7 * beside.declared_mib());
  LevelSummary finest;
  EXPECT_LE(one.used_mib(&finest), one.declared_mib());
  EXPECT_GT(finest.oriented_elements, 0);
  one.options.momenta.shear_weights = 0;  // two rounds let more of them in
  EXPECT_LE(one.used_mib(&finest), one.declared_mib());
  EXPECT_GT(finest.oriented_elements, static_cast<int>(one.input.fixed.samples.size() / 5) / 9);
  Case exact(Model::Sliding, SimilarityType::Lncc);
  exact.options.flow.evolution = Evolution::Exact;
  exact.options.momenta.orientations = 9;
  exact.options.momenta.oriented_alone = 2;
  exact.options.momenta.sparsity = 1e-3;
  exact.add_masks();
  EXPECT_LE(exact.used_mib(), exact.declared_mib());
}

// Of what wants to be active a third may, the strongest; the estimate falls with what is then in use.
TEST(MemoryEstimate, IsABoundWhereFewMayBeActive) {
  Case all(Model::Sliding);
  all.options.momenta.sparsity = 1e-3;
  all.options.optimisation.history = 6;
  all.fill_pairs();
  all.options.optimisation.tolerance = all.options.optimisation.optimality_tolerance = 0;
  Case few = all;
  few.options.momenta.most_active_share = 1.0 / 3;
  LevelSummary of_all, of_few;
  const double used_all = all.used_mib(&of_all), used_few = few.used_mib(&of_few);
  EXPECT_GT(of_all.active_block_share, 0.9);
  EXPECT_EQ(of_all.kept_out_share, 0);
  EXPECT_LE(of_few.active_block_share, 1.0 / 3);
  EXPECT_GT(of_few.kept_out_share, 0.5);
  EXPECT_LE(used_few, few.declared_mib());
  EXPECT_LT(few.declared_mib(), 0.8 * all.declared_mib());
  EXPECT_LT(used_few, 0.8 * used_all);
}

// Where order 0 ends before the images do, a narrower scale is there beside first orders as well.
TEST(MemoryEstimate, CountsANarrowerScaleBesideFirstOrders) {
  Case one(Model::Auto, SimilarityType::Lncc, Preset::Accurate, 4);
  const Lattice<3> image = lattice_of(one.input.fixed.grid);
  const RegistrationOptions options = resolved(one.options, image);
  ASSERT_GT(options.momenta.narrower_pull, 0);
  ASSERT_GT(options.momenta.finest_scale, options.pyramid.finest_level);
  Case without = one;
  without.options.momenta.narrower_pull = 0;
  const auto sites = static_cast<double>(level_lattice(image, options.momenta.finest_scale + 1).sites());
  // Momenta as optimised and as they are on their way, the velocity, and what the result has of them.
  EXPECT_GT(one.declared_mib() - without.declared_mib(), 3.9 * 3 * sizeof(float) * sites / mib);
}

// It is declared for all blocks and all pairs of the optimiser; what a checkpoint would take is not in use here.
TEST(MemoryEstimate, IsNoneTooLargeWhereEverythingIsInUse) {
  for (Model model : {Model::Gaussian, Model::Wendland, Model::Wendland1, Model::Sliding}) {
    Case one(model);
    one.options.momenta.sparsity = 0;
    one.fill_pairs();
    one.options.optimisation.tolerance = one.options.optimisation.optimality_tolerance = 0;
    const double used = one.used_mib(), declared = one.declared_mib();
    EXPECT_LE(used, declared) << to_string(model);
    EXPECT_GT(used, 0.6 * declared) << to_string(model);
  }
}

TEST(MemoryEstimate, GrowsWithTheStepsAsTheUseDoes) {
  Case few(Model::Wendland), many = few;
  many.options.flow.time_steps = few.options.flow.time_steps + 12;
  const double more_used = many.used_mib() - few.used_mib(), more_declared = many.declared_mib() - few.declared_mib();
  EXPECT_GT(more_used, 0.2 * few.used_mib());
  EXPECT_LE(more_used, 1.2 * more_declared);
  EXPECT_GT(more_used, 0.6 * more_declared);
}

}  // namespace
}  // namespace saltus
