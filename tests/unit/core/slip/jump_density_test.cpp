// Where momenta make a velocity jump, and by how much. Oracles: the synthesised velocity itself on both sides, and
// sheets in closed form.
#include "core/slip/jump_density.h"

#include <gtest/gtest.h>

#include "core/momenta/spread_normals.h"
#include "core/support/errors.h"
#include "tests/support/many_threads.h"
#include "tests/unit/core/slip/made_sheet.h"

namespace saltus {
namespace {

/// A scale with a flat sheet of m_axis, vector c, at the faces above sample `at`.
template <int Dim>
struct FaceSheet {
  std::unique_ptr<MomentumScale<Dim, double>> scale;
  std::vector<double> first;
  Vector<Dim> vector;

  FaceSheet(int axis, int at, KernelSum kernel) {
    MomentumScaleOptions<Dim> options;
    options.kernel = kernel;
    options.lattice.size.fill(33);
    for (int a = 0; a < Dim; ++a) options.lattice.spacing[a] = 1 + 0.2 * a;
    options.lattice.offset.fill(0.3);
    options.orders = Orders::First;
    options.first_weight = 2;
    scale = std::make_unique<MomentumScale<Dim, double>>(options);
    first.assign(Dim * scale->field_size(), 0.0);
    for (int c = 0; c < Dim; ++c) vector[c] = 0.1 * (c + 1);
    for (int slab = 0; slab < options.lattice.size[Dim - 1]; ++slab)
      visit_slab<Dim>(options.lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
        if (index[axis] != at) return;
        for (int c = 0; c < Dim; ++c)
          first[static_cast<std::size_t>(axis) * scale->field_size() + Dim * site + c] = vector[c];
      });
  }
  std::vector<JumpElements<Dim>> elements() const {
    MomentumPointers<double> momenta;
    momenta.first = first.data();
    return jump_elements<Dim, double>(*scale, momenta);
  }
};

/// `widths` are those of a kernel that is a sum of equal parts.
template <int Dim>
void expect_the_jump_of_the_velocity(int axis, const std::vector<double>& widths) {
  constexpr int at = 15;
  std::vector<KernelComponent> parts;
  for (double width : widths) parts.push_back({1 / static_cast<double>(widths.size()), make_wendland_profile(width)});
  FaceSheet<Dim> sheet(axis, at, KernelSum(std::move(parts)));
  const Lattice<Dim>& lattice = sheet.scale->lattice();
  std::vector<double> velocity(sheet.scale->field_size());
  sheet.scale->synthesise(nullptr, sheet.first.data(), velocity.data());
  std::size_t middle = 0, stride = 1, step = 0;
  Vector<Dim> x;
  for (int a = 0; a < Dim; ++a) {
    const int i = a == axis ? at : 16;
    if (a == axis) step = stride;
    middle += stride * static_cast<std::size_t>(i);
    stride *= static_cast<std::size_t>(lattice.size[a]);
    x[a] = lattice.offset[a] + (i + (a == axis ? 0.5 : 0.0)) * lattice.spacing[a];
  }
  const std::vector<JumpElements<Dim>> elements = sheet.elements();
  ASSERT_EQ(elements.size(), 1u);  // whatever the kernel is made of
  ASSERT_EQ(elements[0].spreads.size(), widths.size());
  const JumpDensity<Dim> density(elements);
  const Vector<Dim> found = density.jump_across(x, Vector<Dim>::Unit(axis));
  // They are so wide that the velocity between two samples is what it is beside the sheet, but for 1 - h / 2 sigma.
  double sampled = 0;
  for (const JumpSpread& spread : elements[0].spreads)
    sampled += spread.share * (1 - lattice.spacing[axis] / (2 * spread.width_mm));
  for (int c = 0; c < Dim; ++c) {
    const double jump = velocity[Dim * (middle + step) + c] - velocity[Dim * middle + c];
    EXPECT_NEAR(found[c] * sampled, jump, 1e-3 * std::abs(jump)) << axis << " " << c;
  }
}

TEST(JumpDensity, JumpsByWhatTheVelocityDoes) {
  for (const std::vector<double>& widths : {std::vector<double>{12}, {12, 10}}) {
    for (int axis : {0, 1}) expect_the_jump_of_the_velocity<2>(axis, widths);
    for (int axis : {0, 2}) expect_the_jump_of_the_velocity<3>(axis, widths);
  }
}

// A layer of elements, whose kernel may be narrower along the normal, one sample thick.
TEST(JumpDensity, JumpsByWhatTheVelocityOfElementsDoes) {
  for (double normal_share : {1.0, 0.5}) {
    MomentumScaleOptions<2> options;
    const double width = 12;
    options.kernel = make_wendland_profile(width);
    options.lattice = {{33, 33}, {1, 1.2}, {0.3, 0.3}};
    options.orders = Orders::First;
    options.first_weight = 2;
    options.normals = spread_normals<2>(4);
    options.oriented_normal_share = normal_share;
    const MomentumScale<2, double> scale(options);
    std::vector<std::uint32_t> elements;
    for (std::uint32_t y = 0; y < 33; ++y) elements.push_back(33 * y + 15);
    const std::vector<double> values(elements.size(), 0.3);
    std::vector<double> corners, velocity(scale.field_size(), 0.0);
    scale.oriented()->place(elements, corners);
    scale.oriented()->add_velocity(elements, corners.data(), values.data(), velocity.data());
    MomentumPointers<double> momenta;
    momenta.elements = &elements;
    momenta.oriented = values.data();
    const JumpDensity<2> density(jump_elements<2, double>(scale, momenta));
    const Vector<2> found = density.jump_across({15.3, 0.3 + 16 * 1.2}, Vector<2>::UnitX());
    const std::size_t middle = 33 * 16 + 15;
    const double jump = velocity[2 * (middle + 1) + 1] - velocity[2 * (middle - 1) + 1];
    EXPECT_GT(std::abs(jump), 0.1);
    EXPECT_NEAR(found[0], 0, 1e-9);
    EXPECT_NEAR(found[1] * (1 - 1 / (normal_share * width)), jump, 2e-3 * std::abs(jump)) << normal_share;
  }
}

TEST(JumpDensity, KnowsNoneOfKernelsThatAreSmooth) {
  EXPECT_TRUE(FaceSheet<2>(0, 15, make_gaussian_profile(9)).elements().empty());
  EXPECT_THROW(JumpDensity<2>(FaceSheet<2>(0, 15, make_gaussian_profile(9)).elements()), InvalidInput);
}

// Rows along the lattice's axes do what one element after the other does.
TEST(JumpDensity, IsTheSameForElementsOneByOne) {
  std::vector<KernelComponent> parts;
  parts.push_back({0.7, make_wendland_profile(5)});
  parts.push_back({0.3, make_wendland_profile(3)});
  const auto rows = FaceSheet<3>(1, 15, KernelSum(std::move(parts))).elements();
  auto single = rows;
  ASSERT_EQ(single.size(), 1u);
  EXPECT_EQ(single[0].axis, 1);
  single[0].axis = -1;
  const JumpDensity<3> a(rows), b(single);
  ASSERT_TRUE(a.lattice() == b.lattice());
  float largest = 0, apart = 0;
  for (std::size_t i = 0; i < a.values().size(); ++i) {
    largest = std::max(largest, std::abs(a.values()[i]));
    apart = std::max(apart, std::abs(a.values()[i] - b.values()[i]));
  }
  EXPECT_GT(largest, 0);
  EXPECT_LT(apart, 1e-3 * largest);
}

// A sheet of more elements than are taken at a time, all of which differ.
JumpElements<3> uneven_sheet() {
  JumpElements<3> sheet = FaceSheet<3>(2, 15, make_wendland_profile(5)).elements().at(0);
  sheet.axis = -1;
  for (std::size_t i = 0; i < sheet.list.size(); ++i) {
    sheet.list[i].normal = Vector<3>(0.3 * std::sin(0.7 * static_cast<double>(i)), 0.9, 1).normalized();
    sheet.list[i].strength = Vector<3>(1, std::cos(0.3 * static_cast<double>(i)), 0.1 * static_cast<double>(i % 7));
  }
  return sheet;
}

TEST(JumpDensity, IsTheSameWithAnyNumberOfThreads) {
  const JumpElements<3> sheet = uneven_sheet();
  ASSERT_GT(sheet.list.size(), 128u);
  const testing::ManyThreads many;
  omp_set_num_threads(1);
  const JumpDensity<3> one({sheet});
  for (int threads : {2, 3, 8}) {
    omp_set_num_threads(threads);
    EXPECT_EQ(JumpDensity<3>({sheet}).values(), one.values()) << threads;
  }
}

// Whatever is added together: pieces that are lists of their own, each with one element at the sheet's corners that has
// no strength, so that all of them are cropped alike.
TEST(JumpDensity, IsTheSumOfItsElements) {
  const JumpElements<3> sheet = uneven_sheet();
  const JumpDensity<3> whole({sheet});
  std::vector<float> sum(whole.values().size(), 0.0f);
  for (std::size_t begin = 0; begin < sheet.list.size(); begin += 50) {
    JumpElements<3> piece = sheet;
    piece.list.assign({sheet.list.front(), sheet.list.back()});
    for (auto& corner : piece.list) corner.strength.setZero();
    const std::size_t end = std::min(sheet.list.size(), begin + 50);
    piece.list.insert(piece.list.end(), sheet.list.begin() + static_cast<std::ptrdiff_t>(begin),
                      sheet.list.begin() + static_cast<std::ptrdiff_t>(end));
    const JumpDensity<3> part({piece});
    ASSERT_TRUE(part.lattice() == whole.lattice());
    for (std::size_t i = 0; i < sum.size(); ++i) sum[i] += part.values()[i];
  }
  float largest = 0, apart = 0;
  for (std::size_t i = 0; i < sum.size(); ++i) {
    largest = std::max(largest, std::abs(whole.values()[i]));
    apart = std::max(apart, std::abs(whole.values()[i] - sum[i]));
  }
  EXPECT_GT(largest, 0);
  EXPECT_LT(apart, 1e-5f * largest);
}

// Elements of one sheet on two lattices, one twice as coarse, add up.
TEST(JumpDensity, AddsScales) {
  JumpElements<2> fine{{{41, 41}, {1, 1}, {0, 0}}, {{3, 1}}, {}}, coarse{{{21, 21}, {2, 2}, {0, 0}}, {{6, 1}}, {}};
  const Vector<2> n(0, 1), t(1, 0);
  for (int i = 0; i < 41; ++i) fine.list.push_back({Vector<2>(i, 20.5), n, 0.75 * t});
  for (int i = 0; i < 21; ++i) coarse.list.push_back({Vector<2>(2 * i, 21), n, 2 * 0.25 * t});
  const Vector<2> found = JumpDensity<2>({coarse, fine}).jump_across(Vector<2>(20, 20.5), n);
  EXPECT_NEAR(found[0], 1, 1e-3);
  EXPECT_NEAR(found[1], 0, 1e-6);
}

// Steps up and to the side, as momenta along the axes make of an oblique line: what they are is one line.
TEST(JumpDensity, SeesTheSlopeOfAStaircase) {
  JumpElements<2> steps{{{61, 61}, {1, 1}, {0, 0}}, {{3, 1}}, {}};
  const Vector<2> jump(2, 1);
  for (int i = 5; i < 56; ++i) {
    // Two to the right, one up: each step has its length times the jump.
    steps.list.push_back({Vector<2>(i, std::floor(i / 2.0) + 10.5), Vector<2>(0, 1), jump});
    if (i % 2 == 1) steps.list.push_back({Vector<2>(i + 0.5, std::floor(i / 2.0) + 11), Vector<2>(-1, 0), jump});
  }
  const Vector<2> n = Vector<2>(-1, 2).normalized();
  const Vector<2> found = JumpDensity<2>({steps}).jump_across(Vector<2>(30, 25.75), n);
  EXPECT_NEAR((found - jump).norm(), 0, 0.03 * jump.norm());
}

}  // namespace
}  // namespace saltus
