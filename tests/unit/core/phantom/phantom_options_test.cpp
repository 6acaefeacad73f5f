#include "core/phantom/phantom_options.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "core/support/errors.h"

namespace saltus {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

TEST(PhantomOptions, DefaultsAreUsable) {
  for (PhantomKind kind :
       {PhantomKind::Rectangle, PhantomKind::Wheel, PhantomKind::Slip, PhantomKind::Thorax, PhantomKind::Smooth})
    EXPECT_THAT(problems(default_phantom_options(kind)), IsEmpty()) << to_string(kind);
  EXPECT_THAT(problems(default_phantom_options(PhantomKind::Slip, 3)), IsEmpty());
}

TEST(PhantomOptions, NamesGoThereAndBack) {
  for (std::string name : {"rectangle", "wheel", "slip", "thorax", "smooth"})
    EXPECT_EQ(to_string(parse_phantom_kind(name)), name);
  EXPECT_EQ(to_string(parse_interface_shape("circle")), "circle");
  EXPECT_EQ(to_string(parse_texture_kind("plain")), "plain");
  EXPECT_THROW(parse_interface_shape("square"), InvalidInput);
}

TEST(PhantomOptions, ProblemsNameFieldAndValue) {
  PhantomOptions options = default_phantom_options(PhantomKind::Slip);
  options.size[0] = 3;
  options.radius_mm = 0;
  options.noise = -1;
  options.slip_mm = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(problems(options), ElementsAre(HasSubstr("size[0] is 3"), HasSubstr("slip is nan"),
                                             HasSubstr("radius is 0"), HasSubstr("noise is -1")));
}

TEST(PhantomOptions, ImpossibleCombinationsAreRefused) {
  EXPECT_THROW(default_phantom_options(PhantomKind::Thorax, 2), InvalidInput);
  EXPECT_THROW(default_phantom_options(PhantomKind::Wheel, 3), InvalidInput);
  PhantomOptions options = default_phantom_options(PhantomKind::Smooth);
  options.displacement_mm = 0.16 * 128;  // the map would come close to folding
  EXPECT_THAT(problems(options), ElementsAre(HasSubstr("displacement is")));
}

}  // namespace
}  // namespace saltus
