// The expert parameters: one table, and what reads it.
#include "core/registration/names.h"
#include "core/registration/options.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <iomanip>
#include <limits>
#include <sstream>

namespace saltus {
namespace {

const Names<Evolution> kEvolutions = {
    {Evolution::Exact, "exact"}, {Evolution::PerOrder, "per_order"}, {Evolution::Carried, "carried"}};

/// As short as six digits where they say it all, and never another number when read back.
std::string format(double value) {
  std::string shown;
  for (int digits = 6; digits <= std::numeric_limits<double>::max_digits10; ++digits) {
    std::ostringstream text;
    text << std::setprecision(digits) << value;
    shown = text.str();
    if (std::strtod(shown.c_str(), nullptr) == value) break;
  }
  return shown;
}

/// One row of the table of expert parameters; `check` returns "" or what is wrong.
struct Parameter {
  std::string name, unit, range, description;
  std::function<std::string(const RegistrationOptions&)> get;
  std::function<bool(RegistrationOptions&, std::string_view)> set;
  std::function<bool(const RegistrationOptions&)> is_valid;
};

enum class Lower { Inclusive, Exclusive };

template <class Access>
Parameter real(std::string name, std::string unit, double low, Lower bound, double high, std::string description,
               Access access) {
  std::string range = (bound == Lower::Exclusive ? "> " : ">= ") + format(low);
  if (std::isfinite(high)) range += ", <= " + format(high);
  return {std::move(name),
          std::move(unit),
          range,
          std::move(description),
          [access](const RegistrationOptions& o) { return format(access(const_cast<RegistrationOptions&>(o))); },
          [access](RegistrationOptions& o, std::string_view text) {
            double value = 0;
            const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
            if (error != std::errc() || end != text.data() + text.size()) return false;
            access(o) = value;
            return true;
          },
          [=](const RegistrationOptions& o) {
            const double value = access(const_cast<RegistrationOptions&>(o));
            return std::isfinite(value) && (bound == Lower::Exclusive ? value > low : value >= low) && value <= high;
          }};
}

/// A number from `low` to `high`, or 0 for what the model makes of it.
template <class Access>
Parameter real_or_zero(std::string name, std::string unit, double low, double high, std::string description,
                       Access access) {
  Parameter made = real(std::move(name), std::move(unit), low, Lower::Inclusive, high, std::move(description), access);
  made.range = "0, or " + made.range;
  made.is_valid = [access, is_in_range = std::move(made.is_valid)](const RegistrationOptions& o) {
    return access(const_cast<RegistrationOptions&>(o)) == 0 || is_in_range(o);
  };
  return made;
}

template <class Access>
Parameter integer(std::string name, std::string unit, int low, int high, std::string description, Access access) {
  return {
      std::move(name),
      std::move(unit),
      std::to_string(low) + " to " + std::to_string(high),
      std::move(description),
      [access](const RegistrationOptions& o) { return std::to_string(access(const_cast<RegistrationOptions&>(o))); },
      [access](RegistrationOptions& o, std::string_view text) {
        int value = 0;
        const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
        if (error != std::errc() || end != text.data() + text.size()) return false;
        access(o) = value;
        return true;
      },
      [=](const RegistrationOptions& o) {
        const int value = access(const_cast<RegistrationOptions&>(o));
        return value >= low && value <= high;
      }};
}

template <class Access>
Parameter boolean(std::string name, std::string description, Access access) {
  return {std::move(name),
          "",
          "true|false",
          std::move(description),
          [access](const RegistrationOptions& o) {
            return std::string(access(const_cast<RegistrationOptions&>(o)) ? "true" : "false");
          },
          [access](RegistrationOptions& o, std::string_view text) {
            if (text != "true" && text != "false") return false;
            access(o) = text == "true";
            return true;
          },
          [](const RegistrationOptions&) { return true; }};
}

template <class Value, class Access>
Parameter choice(std::string name, const Names<Value>& names, std::string description, Access access) {
  std::string range;
  for (const auto& [value, text] : names) range += (range.empty() ? "" : "|") + std::string(text);
  return {std::move(name),
          "",
          range,
          std::move(description),
          [access, names](const RegistrationOptions& o) {
            return name_of(names, access(const_cast<RegistrationOptions&>(o)));
          },
          [access, names](RegistrationOptions& o, std::string_view text) {
            for (const auto& [value, candidate] : names) {
              if (text != candidate) continue;
              access(o) = value;
              return true;
            }
            return false;
          },
          [](const RegistrationOptions&) { return true; }};
}

bool parse_number(std::string_view digits, double& value) {
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  return error == std::errc() && end == digits.data() + digits.size();
}

/// "6:1,12:0.5", or "none" for an empty list.
bool parse_widths(std::string_view text, std::vector<KernelWidth>& widths) {
  widths.clear();
  if (text == "none") return true;
  for (;;) {
    const std::string_view one = text.substr(0, text.find(','));
    const std::size_t colon = one.find(':');
    if (colon == std::string_view::npos) return false;
    KernelWidth width;
    if (!parse_number(one.substr(0, colon), width.voxels) || !parse_number(one.substr(colon + 1), width.weight))
      return false;
    widths.push_back(width);
    if (one.size() == text.size()) return true;
    text.remove_prefix(one.size() + 1);
  }
}

std::string format(const std::vector<KernelWidth>& widths) {
  std::string text;
  for (const KernelWidth& width : widths)
    text += (text.empty() ? "" : ",") + format(width.voxels) + ":" + format(width.weight);
  return text.empty() ? "none" : text;
}

template <class Access>
Parameter direction(std::string name, std::string description, Access access) {
  return {std::move(name),
          "",
          "none or 2 or 3 numbers with commas between, a vector of length 1",
          std::move(description),
          [access](const RegistrationOptions& o) {
            std::string text;
            for (double component : access(const_cast<RegistrationOptions&>(o)))
              text += (text.empty() ? "" : ",") + format(component);
            return text.empty() ? "none" : text;
          },
          [access](RegistrationOptions& o, std::string_view text) {
            std::vector<double>& vector = access(o);
            vector.clear();
            if (text == "none") return true;
            for (;;) {
              const std::string_view one = text.substr(0, text.find(','));
              if (!parse_number(one, vector.emplace_back())) return false;
              if (one.size() == text.size()) return true;
              text.remove_prefix(one.size() + 1);
            }
          },
          [access](const RegistrationOptions& o) {
            const std::vector<double>& vector = access(const_cast<RegistrationOptions&>(o));
            double square = 0;
            for (double component : vector) square += component * component;
            return vector.empty() ||
                   ((vector.size() == 2 || vector.size() == 3) && std::abs(std::sqrt(square) - 1) <= 0.01);
          }};
}

template <class Access>
Parameter kernel_widths(std::string name, std::string unit, std::string description, Access access) {
  return {std::move(name),
          std::move(unit),
          "none or up to 8 of WIDTH:WEIGHT with commas between, widths 1 to 64, weights > 0",
          std::move(description),
          [access](const RegistrationOptions& o) { return format(access(const_cast<RegistrationOptions&>(o))); },
          [access](RegistrationOptions& o, std::string_view text) { return parse_widths(text, access(o)); },
          [access](const RegistrationOptions& o) {
            const std::vector<KernelWidth>& widths = access(const_cast<RegistrationOptions&>(o));
            return widths.size() <= 8 && std::all_of(widths.begin(), widths.end(), [](const KernelWidth& width) {
                     return width.voxels >= 1 && width.voxels <= 64 && width.weight > 0 && std::isfinite(width.weight);
                   });
          }};
}

const std::vector<Parameter>& parameters() {
  using O = RegistrationOptions;
  constexpr double inf = std::numeric_limits<double>::infinity();
  static const std::vector<Parameter> table = {
      integer(
          "levels", "", 0, 8, "number of image pyramid levels; 0: by the size of the image",
          [](O & o) -> auto& { return o.pyramid.levels; }),
      integer(
          "finest_level", "", -1, 4, "0: the optimisation ends at full resolution, 1: at half, ...; -1: by preset",
          [](O & o) -> auto& { return o.pyramid.finest_level; }),
      real(
          "region_margin", "voxels of the level", -1, Lower::Inclusive, inf,
          "images are compared in the box where one of them shows more than background, and so much around it; -1: "
          "everywhere",
          [](O & o) -> auto& { return o.pyramid.region_margin; }),
      real_or_zero(
          "width_voxels", "voxels of the scale", 1, 64,
          "kernel width sigma of every scale that no sum of widths is given for; 0: 6, or with order 0 the sum of "
          "widths that suits model, similarity and noise",
          [](O & o) -> auto& { return o.momenta.width_voxels; }),
      kernel_widths(
          "kernel_widths", "voxels of the scale",
          "the kernel of scales with order 0 as a weighted sum of widths, in place of width_voxels; 6:1,12:0.5 is two "
          "thirds of width 6 and one of 12; each width costs as much as the first; none: width_voxels, and where that "
          "is 0 what it stands for",
          [](O & o) -> auto& { return o.momenta.kernel_widths; }),
      real(
          "narrow_width_shear", "", -1, Lower::Inclusive, inf,
          "while order 0 is alone, its finest scale counts all widths of kernel_widths but the widest a fifth if the "
          "displacement of the next coarser level is simple shear to less than this (as first_order_shear); 0: never, "
          "-1 (and nothing else below 0): by similarity and dimension, 0 where kernel_widths or width_voxels is given",
          [](O & o) -> auto& { return o.momenta.narrow_width_shear; }),
      real(
          "narrower_pull", "", -1, Lower::Inclusive, inf,
          "where order 0 has settled (at its limit of iterations: by tolerance), alone and with all of its scales, "
          "on the level that is as fine as these (the finest one, or one before), it goes on with one more, Gaussian "
          "and 2 (with lncc 3) voxels of the finest scale wide, if the square of what pulls at that is so many times "
          "what noise (1 % of the intensity range at least) makes of it and, not with ssd, a tenth (with mind half) "
          "more times than at the finest scale; on a level without first orders only if less simple shear than "
          "first_order_shear shows; 0: never, -1 (and nothing else below 0): by similarity and dimension, 0 where "
          "kernel_widths, width_voxels, another coarsening or first_order_shear 0 is given",
          [](O & o) -> auto& { return o.momenta.narrower_pull; }),
      kernel_widths(
          "first_order_kernel_widths", "voxels of the scale",
          "as kernel_widths, for scales of order 1 that have a kernel of their own (models sliding and auto); none: "
          "width_voxels",
          [](O & o) -> auto& { return o.momenta.first_order_kernel_widths; }),
      integer(
          "scales", "", 0, 8, "number of order-0 scales, each twice as wide as the next finer; 0: one a level",
          [](O & o) -> auto& { return o.momenta.scales; }),
      integer(
          "finest_scale", "", -2, 7,
          "voxel of the finest order-0 scale is 2^this reference voxels; -1: the finest level's, but where order 0 is "
          "Gaussian and the similarity not ssd at least 1 in 2-D, and in 3-D where accurate takes voxels of up to 1.5 "
          "mm; at least 1 as well for wendland1 in 3-D; -2: the next coarser",
          [](O & o) -> auto& { return o.momenta.finest_scale; }),
      real(
          "regularisation", "per mm^2", 0, Lower::Inclusive, inf,
          "weight of the order-0 part of the energy; 0: by similarity, with ssd 3e-6 in 2-D and 1e-6 in 3-D",
          [](O & o) -> auto& { return o.momenta.regularisation; }),
      real(
          "coarser_regularisation", "", 0, Lower::Exclusive, 1,
          "weight of an order-0 scale as a share of that of the next finer one; that of the finest is regularisation. "
          "Below 1 large motion costs less than what changes from voxel to voxel",
          [](O & o) -> auto& { return o.momenta.coarser_regularisation; }),
      real(
          "regularisation_beside_first", "per mm^2", 0, Lower::Inclusive, inf,
          "weight of the order-0 part once first orders take part; 0: that of regularisation, or what full_contrast "
          "says, and for auto, but fast, ten times that with lncc, three times with mi and ngf, in 2-D twice with "
          "mind, but in 3-D five times with lncc, once with ngf and half with mind where "
          "first_order_shear asks. Given alone it is that of plain slips as well, and with lncc, ngf and mind more is "
          "asked of all",
          [](O & o) -> auto& { return o.momenta.regularisation_beside_first; }),
      real(
          "regularisation_beside_plain", "per mm^2", 0, Lower::Inclusive, inf,
          "the same where a plain slip let them in (plain_shear, settled_plain_shear); 0: that of "
          "regularisation_beside_first, and where that is 0 for auto in 3-D, but fast, ten times regularisation "
          "with lncc, three times with ngf and once with mind",
          [](O & o) -> auto& { return o.momenta.regularisation_beside_plain; }),
      integer(
          "first_order_scales", "", 0, 8, "number of order-1 scales; 0 leaves order 1 out",
          [](O & o) -> auto& { return o.momenta.first_order_scales; }),
      integer(
          "first_order_finest_scale", "", -1, 7,
          "as finest_scale, for order 1, and the flow beside it (see coarsening); -1: "
          "the finest level's, at least 1 in 3-D for wendland1, and for auto with all but ssd where accurate takes "
          "voxels of up to 1.5 mm",
          [](O & o) -> auto& { return o.momenta.first_order_finest_scale; }),
      real(
          "first_order_regularisation", "per mm^2", 0, Lower::Exclusive, inf,
          "weight of the order-1 part of the energy",
          [](O & o) -> auto& { return o.momenta.first_order_regularisation; }),
      real(
          "sparsity", "per mm", -1, Lower::Inclusive, inf,
          "lambda of the group L1 norm on first-order momenta, as velocities; -1 (and nothing else below 0): by model, "
          "similarity, preset and dimension",
          [](O & o) -> auto& { return o.momenta.sparsity; }),
      real(
          "sparsity_noise", "intensity range", 0, Lower::Inclusive, 1,
          "sparsity counts 1 + (standard deviation of the noise on the finest level) / this times, twice at this "
          "noise; 0: it does not follow the noise",
          [](O & o) -> auto& { return o.momenta.sparsity_noise; }),
      real(
          "full_contrast", "intensity range", 0, Lower::Inclusive, inf,
          "with ssd: where the fixed image's root mean square gradient over a voxel of the finest level is a share of "
          "this, sparsity counts its square, order 0 beside first orders that share, and so does oriented_width where "
          "none is given, the less the more noise there is; a quarter at least; rounds go on for longer, see "
          "tolerance, round_tolerance and first_round_tolerance; 0: they do not follow it",
          [](O & o) -> auto& { return o.momenta.full_contrast; }),
      integer(
          "sparsity_path", "", 1, 12,
          "weights that a level goes through, each half the one before, down to sparsity; none where a coarser level "
          "found first orders and reweighted rounds follow, or shear_weights take its place",
          [](O & o) -> auto& { return o.momenta.sparsity_path; }),
      real(
          "even_sparsity", "", 1, Lower::Inclusive, 100,
          "sparsity counts so many times in the rounds with even weights that reweighted rounds follow",
          [](O & o) -> auto& { return o.momenta.even_sparsity; }),
      integer(
          "shear_weights", "", -1, 2,
          "1: where first orders wait and oriented momenta are alone, the first weights of these follow how strongly "
          "the velocity of order 0 changes where they are, in place of a path of even ones; 2: in place of the first "
          "reweighted round as well; 0: they do not, -1: by similarity and dimension, 0 without reweighted "
          "rounds and where sparsity_path or even_sparsity is not the usual one",
          [](O & o) -> auto& { return o.momenta.shear_weights; }),
      integer(
          "reweighted_rounds", "", 0, 10,
          "times that a level is solved again with sparsity weights made from the momenta found; of the first level "
          "that has any one less with shear_weights 2",
          [](O & o) -> auto& { return o.momenta.reweighted_rounds; }),
      boolean(
          "debias", "solve a level once more on the first-order momenta found, without their sparsity term",
          [](O & o) -> auto& { return o.momenta.debias; }),
      direction(
          "direction",
          "model directional only: unit normal, in world coordinates (LPS), of the interface that may slide, such as "
          "1,0,0; none when a field of directions is given",
          [](O & o) -> auto& { return o.momenta.direction; }),
      real(
          "first_order_shear", "", -1, Lower::Inclusive, inf,
          "order 1 takes part only where the displacement of order 0, settled alone, is simple shear to so much, as it "
          "is or less what most of the image does (smooth motion mostly has 1 to 5); 0: always, -1 (and nothing else "
          "below 0): by similarity, dimension and preset, and whether regularisation_beside_first alone is given",
          [](O & o) -> auto& { return o.momenta.first_order_shear; }),
      real(
          "plain_shear", "", -1, Lower::Inclusive, inf,
          "order 1 takes part without waiting for order 0 to settle where that shows so much simple shear after three "
          "iterations of a level; 0: always waits, -1 (and nothing else below 0): twice first_order_shear where that "
          "is known to cost nothing, 1.6 times where with balanced order 0 is slow to settle, otherwise 0; in 3-D with "
          "lncc, and with balanced where regularisation_beside_plain goes with it, 24 or first_order_shear where that "
          "is more",
          [](O & o) -> auto& { return o.momenta.plain_shear; }),
      real(
          "settled_plain_shear", "", -1, Lower::Inclusive, inf,
          "a slip is plain as well, for regularisation_beside_plain, where order 0 that has settled shows so much "
          "simple shear; 0: none is, -1 (and nothing else below 0): for auto in 3-D, but fast, 20 with lncc and 12 "
          "with ngf and mind unless regularisation_beside_first alone is given, otherwise 0",
          [](O & o) -> auto& { return o.momenta.settled_plain_shear; }),
      real(
          "quick_share", "", -1, Lower::Inclusive, 1,
          "where ten iterations had so large a share of what order 0 brought alone until it settled to tolerance, "
          "which took more than these, it gives up what is sharp when order 1 is let in, and finds anew what it is to "
          "have of that; 0: never, -1 (and nothing else below 0): by model, similarity, dimension and preset, as "
          "measured with their tolerance, where oriented momenta are alone",
          [](O & o) -> auto& { return o.momenta.quick_share; }),
      real(
          "quick_tolerance", "", -1, Lower::Inclusive, 1,
          "the same where after at most ten iterations of order 0, alone, the last five have no more than so large a "
          "share of what all have brought: whether something slides (first_order_shear) is then asked at once, without "
          "waiting for order 0 to settle; 0: it is not, -1 (and nothing else below 0): by model, dimension and preset, "
          "as measured, where oriented momenta are alone, but no less than tolerance",
          [](O & o) -> auto& { return o.momenta.quick_tolerance; }),
      real(
          "finer_shear", "", -1, Lower::Inclusive, inf,
          "where order 1 is left out on the finest level and order 0 ends at a coarser scale, order 0 gets the finer "
          "ones as well, settles again, and order 1 takes part with so much simple shear; 0: no finer ones, -1 (and "
          "nothing else below 0): that of first_order_shear or 0, by similarity, dimension, preset and voxels",
          [](O & o) -> auto& { return o.momenta.finer_shear; }),
      integer(
          "orientations", "", -1, 13,
          "normals that oriented momenta are turned from, so that interfaces that are not along an axis can slide: 4 "
          "or 8 in 2-D, 3, 9 or 13 in 3-D; -1: 8 or 9, where first orders are along the axes, sparse and carried; 0: "
          "none",
          [](O & o) -> auto& { return o.momenta.orientations; }),
      real(
          "oriented_sparsity", "", 0, Lower::Inclusive, 100,
          "weight of the group norm of oriented momenta, as a share of sparsity: they appear only where the velocity "
          "shows an interface; 0: by similarity and dimension",
          [](O & o) -> auto& { return o.momenta.oriented_sparsity; }),
      real_or_zero(
          "oriented_width", "", 0.1, 2,
          "width of the kernel of oriented momenta along their normal, as a share of the first orders' width; 0: by "
          "similarity, dimension and, with ssd, contrast",
          [](O & o) -> auto& { return o.momenta.oriented_width; }),
      real(
          "oblique_share", "", -1, Lower::Inclusive, 1,
          "oriented momenta begin only where so large a share of what may slide is oblique to the axes; 0: always, -1 "
          "(and nothing else below 0): by similarity and dimension",
          [](O & o) -> auto& { return o.momenta.oblique_share; }),
      integer(
          "oriented_alone", "", -1, 2,
          "1: where a scale's oriented momenta have been turned to an interface and it has none along the axes, none "
          "of these appear, and the oriented ones take interfaces along the axes as well; 2: beside a Gaussian order "
          "0 there are oriented ones alone; 0: both may; -1: by similarity and dimension, with ssd "
          "by full_contrast",
          [](O & o) -> auto& { return o.momenta.oriented_alone; }),
      boolean(
          "first_order_waits",
          "on each level let order 0 settle before first-order momenta appear, so that they are few",
          [](O & o) -> auto& { return o.momenta.first_order_waits; }),
      real_or_zero(
          "most_active_share", "of the blocks at full resolution", 0.01, 1,
          "where there is sparsity, a scale's first-order momenta are in so many blocks of 4 sites a side at most, "
          "which bounds the memory; where more want to be those are that pull hardest; coarser levels have room for "
          "all from 0.125 on; 0: all, with model auto in 3-D three quarters",
          [](O & o) -> auto& { return o.momenta.most_active_share; }),
      boolean(
          "shear_only", "leave out the component of m_i along axis i, so that a jump can only slide",
          [](O & o) -> auto& { return o.momenta.shear_only; }),
      choice(
          "evolution", kEvolutions,
          "how momenta evolve: the geodesic of the metric, order by order, or without turning",
          [](O & o) -> auto& { return o.flow.evolution; }),
      integer(
          "time_steps", "", 1, 64, "steps of the flow over [0,1]", [](O & o) -> auto& { return o.flow.time_steps; }),
      integer(
          "map_steps", "", 1, 16, "steps of the map in each time step; the velocity is linear in time over them",
          [](O & o) -> auto& { return o.flow.map_steps; }),
      real(
          "map_tolerance", "voxels of the level", 0, Lower::Inclusive, inf,
          "above 0: as many steps of the map on each level as follow 99.9 % of its sites so exactly, on the finest at "
          "least map_steps",
          [](O & o) -> auto& { return o.flow.map_tolerance; }),
      integer(
          "coarsening", "levels", 0, 3,
          "order 0, and the flow while there is no order 1, are sampled so much coarser than the images of a level; "
          "beside order 1 the flow is where that is, but no coarser than this",
          [](O & o) -> auto& { return o.flow.coarsening; }),
      real(
          "divergence_weight", "", -1, Lower::Inclusive, inf,
          "weight of the divergence of the velocity, which leaves sliding free and holds back opening and overlap; -1 "
          "(and nothing else below 0): by similarity and dimension",
          [](O & o) -> auto& { return o.flow.divergence_weight; }),
      real(
          "similarity_weight", "", 0, Lower::Exclusive, inf, "multiplies the similarity",
          [](O & o) -> auto& { return o.similarity_parameters.weight; }),
      real(
          "noise", "intensity range", -1, Lower::Inclusive, 1,
          "standard deviation of the images' noise, which the smoothing of both images, the weight of ssd, the kernel "
          "widths chosen for other similarities and sparsity (as sparsity_noise says) follow; -1: estimated from the "
          "images",
          [](O & o) -> auto& { return o.similarity_parameters.noise; }),
      real(
          "ssd_residual", "intensity range", 0, Lower::Exclusive, inf,
          "standard deviation of what ssd leaves beside the noise: its weight is 1 / (1 + (noise / this)^2)",
          [](O & o) -> auto& { return o.similarity_parameters.ssd_residual; }),
      real(
          "smoothing_voxels", "voxels of the level", -1, Lower::Inclusive, 8,
          "standard deviation of the Gaussian that both images are smoothed with on every level; -1: from the noise",
          [](O & o) -> auto& { return o.similarity_parameters.smoothing_voxels; }),
      real_or_zero(
          "lost_noise", "intensity range", 1e-4, 1,
          "standard deviation of what linear interpolation half way between samples may take from the noise, which "
          "smoothing_voxels -1 follows on all levels; 0, as lncc and ngf have it with accurate: 0.0075, but for "
          "auto in 3-D 0.003 where accurate takes voxels of up to 1.5 mm",
          [](O & o) -> auto& { return o.similarity_parameters.lost_noise; }),
      real(
          "ncc_floor", "intensity range", 0, Lower::Exclusive, 1, "standard deviation below which an image is flat",
          [](O & o) -> auto& { return o.similarity_parameters.ncc_floor; }),
      real_or_zero(
          "lncc_radius_voxels", "voxels of the level", 0.1, 16,
          "half width of the window of lncc; 0: 4 in 2-D, where a window holds fewer samples, and 2 in 3-D",
          [](O & o) -> auto& { return o.similarity_parameters.lncc_radius_voxels; }),
      integer(
          "lncc_cell", "voxels of the level", 0, 2,
          "windows of lncc are made of cells of so many voxels a side and move by a cell; 2 takes a third of the time "
          "and "
          "loses some accuracy in 3-D; 0: 2 in 2-D and 1 in 3-D",
          [](O & o) -> auto& { return o.similarity_parameters.lncc_cell; }),
      real(
          "lncc_floor", "intensity range", 0, Lower::Exclusive, 1, "standard deviation below which a window is flat",
          [](O & o) -> auto& { return o.similarity_parameters.lncc_floor; }),
      integer(
          "mi_bins", "", 8, 256, "bins for each image in the joint histogram of mi",
          [](O & o) -> auto& { return o.similarity_parameters.mi_bins; }),
      real(
          "ngf_edge", "intensity range per mm", 0, Lower::Inclusive, inf,
          "gradient below which ngf sees no edge; 0: from the noise of each image",
          [](O & o) -> auto& { return o.similarity_parameters.ngf_edge; }),
      real(
          "mind_radius_voxels", "voxels of the level", 0, Lower::Inclusive, 64, "half width of the patches of mind",
          [](O & o) -> auto& { return o.similarity_parameters.mind_radius_voxels; }),
      real(
          "mind_step_voxels", "voxels of the level", 0, Lower::Exclusive, 64,
          "distance of the neighbours whose patches mind compares",
          [](O & o) -> auto& { return o.similarity_parameters.mind_step_voxels; }),
      integer(
          "max_iterations", "", 0, 10000, "iterations in each round of a level",
          [](O & o) -> auto& { return o.optimisation.max_iterations; }),
      real(
          "tolerance", "", 0, Lower::Inclusive, 1,
          "a level ends when five iterations give less than this share of its decrease; with ssd and keep_pairs it "
          "counts the contrast, see full_contrast, 0.56 at least",
          [](O & o) -> auto& { return o.optimisation.tolerance; }),
      real(
          "round_tolerance", "", -1, Lower::Inclusive, 1,
          "the same of a round with first-order momenta that another one follows, where larger than tolerance; without "
          "keep_pairs it counts the square of the contrast, see full_contrast; -1 (and nothing else below 0): what "
          "suits model, similarity, preset and dimension",
          [](O & o) -> auto& { return o.optimisation.round_tolerance; }),
      real(
          "first_round_tolerance", "", -1, Lower::Inclusive, 1,
          "the same of the first round of a level where a coarser one has found first orders and they do not wait; -1 "
          "(and nothing else below 0): round_tolerance, with keep_pairs times the square of the contrast, see "
          "full_contrast, but no less than tolerance as it was given over the contrast's root",
          [](O & o) -> auto& { return o.optimisation.first_round_tolerance; }),
      boolean(
          "keep_pairs",
          "a round that differs from the one before by the weights of its sparsity, and by how far oriented momenta "
          "have turned, begins with the pairs that L-BFGS has",
          [](O & o) -> auto& { return o.optimisation.keep_pairs; }),
      real(
          "look_tolerance", "", 0, Lower::Inclusive, 1,
          "the same of a round of order 0 alone, where smaller than tolerance: on a level without first orders, with "
          "finer or narrower scales, or where something may slide and did not show when it had settled to tolerance, "
          "before it is asked again; 0: tolerance",
          [](O & o) -> auto& { return o.optimisation.look_tolerance; }),
      real(
          "optimality_tolerance", "", 0, Lower::Inclusive, 1,
          "a level ends when the optimality residual falls to this share of its first value",
          [](O & o) -> auto& { return o.optimisation.optimality_tolerance; }),
      real(
          "noise_tolerance", "", 0, Lower::Inclusive, 1,
          "a round without first-order momenta ends when the square of that residual is at most this share of what the "
          "images' noise alone makes of it; 0: does not",
          [](O & o) -> auto& { return o.optimisation.noise_tolerance; }),
      integer(
          "history", "", 0, 50,
          "pairs that L-BFGS keeps; 0: 4 in 3-D (`wendland1` 2), 6 in 2-D, there with ssd and `sliding` 20, `auto` 32",
          [](O & o) -> auto& { return o.optimisation.history; }),
  };
  return table;
}

}  // namespace

std::vector<ParameterInfo> list_parameters(const RegistrationOptions& options) {
  std::vector<ParameterInfo> list;
  for (const Parameter& p : parameters()) list.push_back({p.name, p.get(options), p.unit, p.range, p.description});
  return list;
}

void set_parameter(RegistrationOptions& options, std::string_view name, std::string_view value) {
  for (const Parameter& p : parameters()) {
    if (p.name != name) continue;
    RegistrationOptions changed = options;
    if (!p.set(changed, value) || !p.is_valid(changed))
      throw InvalidInput("parameter " + p.name + " is '" + std::string(value) + "'; it must be " + p.range);
    options = changed;
    return;
  }
  throw InvalidInput("there is no parameter '" + std::string(name) + "'; `saltus register --set help` lists them");
}

std::vector<std::string> problems(const RegistrationOptions& options) {
  std::vector<std::string> found;
  for (const Parameter& p : parameters())
    if (!p.is_valid(options))
      found.push_back("parameter " + p.name + " is " + p.get(options) + "; it must be " + p.range);
  if (options.pyramid.levels > 0 && options.pyramid.finest_level >= options.pyramid.levels)
    found.push_back("parameter finest_level is " + std::to_string(options.pyramid.finest_level) +
                    "; it must be less than levels, which is " + std::to_string(options.pyramid.levels));
  const double sparsity = options.momenta.sparsity;
  if (sparsity > -1 && sparsity < 0)
    found.push_back("parameter sparsity is " + format(sparsity) +
                    "; below 0 it must be -1, which stands for what was measured");
  const double shear = options.momenta.first_order_shear;
  const std::string given_shear = "parameter first_order_shear is " + std::to_string(shear);
  if (shear > -1 && shear < 0)
    found.push_back(given_shear + "; below 0 it must be -1, which stands for what was measured");
  else if (shear != 0 && options.model == Model::Directional)
    found.push_back(given_shear + " and the model is directional, whose first orders always take part; it must be 0");
  else if (shear > 0 && options.momenta.first_order_scales == 0)
    found.push_back(given_shear +
                    " and first_order_scales is 0, with which there are no first orders that could be left out; set it "
                    "to 0, or give a model that has some, such as sliding");
  else if (shear > 0 && options.momenta.sparsity == 0)
    found.push_back(given_shear +
                    " and sparsity is 0, with which first orders always take part; set that above 0, or this to 0");
  const double plain = options.momenta.plain_shear;
  for (const auto& [name, asked] :
       {std::pair("plain_shear", plain), std::pair("settled_plain_shear", options.momenta.settled_plain_shear),
        std::pair("finer_shear", options.momenta.finer_shear), std::pair("quick_share", options.momenta.quick_share),
        std::pair("quick_tolerance", options.momenta.quick_tolerance),
        std::pair("narrower_pull", options.momenta.narrower_pull)})
    if (asked > 0 && shear == 0)
      found.push_back("parameter " + std::string(name) + " is " + format(asked) +
                      " and first_order_shear is 0, with which nothing is asked of order 0; set it to 0");
  if (options.momenta.finer_shear > 0 && options.momenta.first_order_waits)
    found.push_back("parameter finer_shear is " + format(options.momenta.finer_shear) +
                    " and first_order_waits is true, with which order 0 has all of its scales; set it to 0");
  for (const auto& [name, quick] : {std::pair("quick_share", options.momenta.quick_share),
                                    std::pair("quick_tolerance", options.momenta.quick_tolerance)})
    if (quick > 0 && !options.momenta.first_order_waits)
      found.push_back("parameter " + std::string(name) + " is " + format(quick) +
                      " and first_order_waits is false, with which order 0 begins where the level began; let first "
                      "orders wait, or set it to 0");
  if (options.momenta.quick_tolerance > 0 && options.momenta.quick_tolerance < options.optimisation.tolerance)
    found.push_back("parameter quick_tolerance is " + format(options.momenta.quick_tolerance) + " and tolerance is " +
                    format(options.optimisation.tolerance) +
                    ", which order 0 has settled to before it is quick; set it to that or more, or to 0");
  const std::pair<const char*, double> measured[] = {
      {"oblique_share", options.momenta.oblique_share},
      {"narrow_width_shear", options.momenta.narrow_width_shear},
      {"narrower_pull", options.momenta.narrower_pull},
      {"divergence_weight", options.flow.divergence_weight},
      {"plain_shear", options.momenta.plain_shear},
      {"settled_plain_shear", options.momenta.settled_plain_shear},
      {"finer_shear", options.momenta.finer_shear},
      {"quick_share", options.momenta.quick_share},
      {"quick_tolerance", options.momenta.quick_tolerance},
      {"round_tolerance", options.optimisation.round_tolerance},
      {"first_round_tolerance", options.optimisation.first_round_tolerance}};
  for (const auto& [name, value] : measured)
    if (value > -1 && value < 0)
      found.push_back("parameter " + std::string(name) + " is " + format(value) +
                      "; below 0 it must be -1, which stands for what was measured");
  if (options.momenta.oriented_alone == 2 && options.momenta.orientations != 0 && !options.momenta.first_order_waits &&
      options.momenta.reweighted_rounds == 0)
    found.push_back(
        "parameter oriented_alone is 2, first_order_waits is false and reweighted_rounds is 0; oriented momenta are "
        "where a round before shows an interface, so let first orders wait, or give one reweighted round or more");
  if (options.momenta.shear_weights > 0 && !options.momenta.first_order_waits)
    found.push_back("parameter shear_weights is " + std::to_string(options.momenta.shear_weights) +
                    " and first_order_waits is false; order 0 has not settled before first orders begin, so let them "
                    "wait, or set shear_weights to 0");
  if (options.momenta.shear_weights > 0 && (!is_zeroth_gaussian(options.model) || options.momenta.orientations == 0 ||
                                            options.momenta.oriented_alone == 0 || options.momenta.oriented_alone == 1))
    found.push_back("parameter shear_weights is " + std::to_string(options.momenta.shear_weights) + " with model " +
                    to_string(options.model) + ", orientations " + std::to_string(options.momenta.orientations) +
                    " and oriented_alone " + std::to_string(options.momenta.oriented_alone) +
                    "; it is for oriented momenta that are alone, so choose model auto with orientations of -1 and "
                    "oriented_alone 2, or set shear_weights to 0");
  if (options.momenta.orientations > 0) {
    const std::string given = "parameter orientations is " + std::to_string(options.momenta.orientations);
    if (options.momenta.first_order_scales == 0 || options.model == Model::Directional)
      found.push_back(given + " and model " + to_string(options.model) +
                      " has no first orders along the axes; choose model sliding or wendland1, or set it to 0");
    else if (options.momenta.sparsity == 0)
      found.push_back(given + " and sparsity is 0; oriented momenta need a sparsity above 0");
  }
  if (!options.momenta.first_order_kernel_widths.empty() && !may_have_first_order_alone(options))
    found.push_back("parameter first_order_kernel_widths is " + format(options.momenta.first_order_kernel_widths) +
                    " and model " + to_string(options.model) +
                    " has no scale of order 1 alone, which it is for; set it to none, or choose model sliding or auto "
                    "with first_order_scales above 0");
  if (options.threads < 0) found.push_back("threads is " + std::to_string(options.threads) + "; it must be 0 or more");
  return found;
}

}  // namespace saltus
