#include "core/registration/slip_criteria.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <limits>

namespace saltus {
namespace {

/// Where slips that are plain and others are told apart: first orders are let in by either, and order 0 is held more
/// beside those of the former (stiffer). As measured; core/measurements.md, "Slips that are not plain". Not where
/// one weight is given for both.
bool tells_plain(int dimension, const RegistrationOptions& options) {
  const RegistrationOptions::Momenta& momenta = options.momenta;
  const bool is_given = momenta.regularisation_beside_first > 0 && momenta.regularisation_beside_plain == 0;
  return options.model == Model::Auto && dimension == 3 && options.preset != Preset::Fast && !is_given &&
         (options.similarity == SimilarityType::Lncc || options.similarity == SimilarityType::Ngf ||
          options.similarity == SimilarityType::Mind);
}

/// What the displacement of order 0 has at least where something slides, see simple_shear; core/measurements.md, "Only
/// where it slides". In 3-D images first orders that hold order 0 back cost much with lncc, ngf and mind, and bring
/// little where much else than shear is seen; order 0 that has not settled (fast) shows less.
double least_shear(int dimension, const RegistrationOptions& options) {
  constexpr double slides = 5;
  if (dimension == 2) return 6;
  if (tells_plain(dimension, options)) return slides;
  switch (options.similarity) {
    case SimilarityType::Lncc:
      return 12;
    case SimilarityType::Ngf:
    case SimilarityType::Mind:
      return options.preset == Preset::Fast ? slides : 10;
    case SimilarityType::Ssd:
    case SimilarityType::Ncc:
    case SimilarityType::Mi:
      return slides;
  }
  return slides;
}

constexpr double kStifferWithLncc = 10;
/// How many times as much order 0 counts beside first orders that were let in: what is sharp is theirs, and order 0
/// draws it out no more. Where a slip is not plain there is more than that to be drawn (core/measurements.md,
/// "Regularisation").
struct Stiffer {
  double beside_first, beside_plain;
};
Stiffer stiffer(int dimension, const RegistrationOptions& options) {
  const bool is_told = tells_plain(dimension, options);
  switch (options.similarity) {
    case SimilarityType::Lncc:
      return {is_told ? 5 : kStifferWithLncc, kStifferWithLncc};
    case SimilarityType::Ngf:
      return {is_told ? 1.0 : 3.0, 3};
    case SimilarityType::Mi:
      return {3, 3};
    case SimilarityType::Mind:
      if (dimension == 2) return {2, 2};
      return {is_told ? 0.5 : 1.0, 1};
    case SimilarityType::Ssd:
    case SimilarityType::Ncc:
      return {1, 1};
  }
  return {1, 1};
}

/// Without what a product adds to the last digit: 3e-4 for three times 1e-4.
double in_15_digits(double value) {
  std::array<char, 32> text;
  const auto end = std::to_chars(text.data(), text.data() + text.size(), value, std::chars_format::scientific, 14).ptr;
  std::from_chars(text.data(), end, value);
  return value;
}

/// Where it is not given. What is let in unasked has the weight of plain slips, since nobody knows.
void resolve_beside_first(int dimension, RegistrationOptions& o) {
  if (o.model != Model::Auto || o.preset == Preset::Fast || o.momenta.regularisation_beside_first != 0) return;
  const Stiffer times = stiffer(dimension, o);
  const bool is_asked = o.momenta.first_order_shear > 0;
  const double beside_first = is_asked ? times.beside_first : times.beside_plain;
  if (beside_first != 1) o.momenta.regularisation_beside_first = in_15_digits(beside_first * o.momenta.regularisation);
  if (is_asked && times.beside_plain > times.beside_first && o.momenta.regularisation_beside_plain == 0)
    o.momenta.regularisation_beside_plain = in_15_digits(times.beside_plain * o.momenta.regularisation);
}

/// Where what order 0 takes to settle is half of the iterations of a level with first orders, and to do without costs a
/// few hundredths of the error (with mind in 2-D it costs more; core/measurements.md, "Slips that are not plain").
bool is_slow_to_settle(int dimension, const RegistrationOptions& options) {
  if (options.model != Model::Auto || options.preset != Preset::Balanced) return false;
  switch (options.similarity) {
    case SimilarityType::Mi:
    case SimilarityType::Ngf:
      return true;
    case SimilarityType::Mind:
      return dimension == 3;
    case SimilarityType::Ssd:
    case SimilarityType::Ncc:
    case SimilarityType::Lncc:
      return false;
  }
  return false;
}

/// What it has at least, early on a level, where order 0 need not settle first: where first orders do not wait for it
/// (ssd), with lncc in 3-D where it goes on beside them with a larger weight, and where it is slow to settle, as
/// measured. With lncc breathing has up to twice as much early as at the end; core/measurements.md, "Only where it
/// slides" and "mi, ngf and mind".
double plain_shear(int dimension, const RegistrationOptions& options) {
  const RegistrationOptions::Momenta& momenta = options.momenta;
  const bool is_lncc = options.similarity == SimilarityType::Lncc, is_told = tells_plain(dimension, options);
  const double beside = is_told ? momenta.regularisation_beside_plain : momenta.regularisation_beside_first;
  const bool is_stiffer = dimension == 3 && is_lncc && beside >= (1 - 1e-9) * kStifferWithLncc * momenta.regularisation;
  const bool is_free = !momenta.first_order_waits || is_stiffer;
  if (!is_free && !is_slow_to_settle(dimension, options)) return 0;
  // Where less is asked of slips that are not plain, or much of all, that is no measure of those that are.
  constexpr double plain = 24;
  if (is_told || is_stiffer) return std::max(momenta.first_order_shear, plain);
  return std::min((is_free ? 2 : 1.6) * momenta.first_order_shear, std::numeric_limits<double>::max());  // finite
}

/// What it has at least in the end, where the slip is plain; core/measurements.md, "Slips that are not plain".
double settled_plain_shear(int dimension, const RegistrationOptions& options) {
  if (!tells_plain(dimension, options)) return 0;
  return options.similarity == SimilarityType::Lncc ? 20 : 12;
}

/// With ssd in 3-D the same once order 0 has all scales. In 2-D a Gaussian of so many pixels follows noise, and smooth
/// motion loses half; core/measurements.md, "Only where it slides".
double finer_shear(int dimension, const RegistrationOptions& options) {
  const bool is_measured = dimension == 3 && options.similarity == SimilarityType::Ssd;
  return is_measured && !options.momenta.first_order_waits ? options.momenta.first_order_shear : 0;
}

/// Order 0 is asked how quick it was beside oriented momenta alone, as measured.
bool may_be_quick(int dimension, const RegistrationOptions& options) {
  const bool is_measured = options.model == Model::Auto && dimension == 3 && options.preset == Preset::Balanced;
  const bool has_elements_alone = options.momenta.orientations > 0 && options.momenta.oriented_alone == 2;
  return is_measured && has_elements_alone && options.momenta.first_order_waits;
}

/// Where a few iterations bring most of what order 0 brings, as where little but a slip is to be seen, they bring it
/// again. Thoraxes and livers have up to 0.64 with mi and up to 0.78 with the others (ngf, voxels of 4 mm);
/// core/measurements.md, "Where order 0 begins beside first orders".
double quick_share(int dimension, const RegistrationOptions& options) {
  if (!may_be_quick(dimension, options)) return 0;
  return options.similarity == SimilarityType::Mi ? 0.7 : 0.79;
}

/// Where that is so plain that order 0 need not settle first. Of what thoraxes and livers in which first orders are let
/// in have brought after ten iterations the last five have 0.26 and more, and slips around bodies from 0.1 on
/// (core/measurements.md, "Quick before it has settled").
double quick_tolerance(int dimension, const RegistrationOptions& options) {
  return may_be_quick(dimension, options) ? std::max(0.22, options.optimisation.tolerance) : 0;
}

}  // namespace

void resolve_slip_criteria(int dimension, RegistrationOptions& o) {
  RegistrationOptions::Momenta& momenta = o.momenta;
  if (momenta.first_order_shear < 0) {  // without sparsity they cannot be left out
    const bool may_be_left_out = momenta.first_order_scales > 0 && momenta.sparsity > 0;
    momenta.first_order_shear = may_be_left_out ? least_shear(dimension, o) : 0;
  }
  resolve_beside_first(dimension, o);
  if (momenta.plain_shear < 0) momenta.plain_shear = plain_shear(dimension, o);
  if (momenta.settled_plain_shear < 0) momenta.settled_plain_shear = settled_plain_shear(dimension, o);
  if (momenta.finer_shear < 0) momenta.finer_shear = finer_shear(dimension, o);
  if (momenta.quick_share < 0) momenta.quick_share = quick_share(dimension, o);
  if (momenta.quick_tolerance < 0) momenta.quick_tolerance = quick_tolerance(dimension, o);
  if (momenta.first_order_shear == 0)  // order 0 is not asked
    momenta.plain_shear = momenta.settled_plain_shear = momenta.finer_shear = momenta.narrower_pull =
        momenta.quick_share = momenta.quick_tolerance = 0;
}

}  // namespace saltus
