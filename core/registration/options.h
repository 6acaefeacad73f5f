#pragma once

#include "core/flow/evolution.h"
#include "core/similarity/similarity_options.h"

#include <string>
#include <string_view>
#include <vector>

namespace saltus {

/// See the table in core/README.md for what each model is made of.
enum class Model { Gaussian, Wendland, Wendland1, Directional, Sliding, Auto };
/// How much work is spent: `Fast` < `Balanced` < `Accurate`.
enum class Preset { Fast, Balanced, Accurate };

/// One width of a kernel that is a sum, and its share relative to the other weights.
struct KernelWidth {
  double voxels = 0;
  double weight = 1;
};

/// Map steps that map_tolerance asks for.
constexpr int kMostMapSteps = 4;

/// Everything that can be chosen about a registration. Defaults depend on model, similarity and preset and are
/// made in one place, default_options. All expert parameters have a name for set_parameter.
struct RegistrationOptions {
  Model model = Model::Auto;
  SimilarityType similarity = SimilarityType::Lncc;
  Preset preset = Preset::Balanced;

  struct Pyramid {
    int levels = 0;         ///< image levels, the coarsest 2^(levels-1) times the reference spacing; 0: until the
                            ///< largest axis has fewer than 32 samples
    int finest_level = -1;  ///< 0: the optimisation ends at full resolution, 1: at half, ...; -1: full resolution in
                            ///< 2-D, in 3-D by preset (fast 2 at most, with voxels no wider than 4 mm; balanced 1 at
                            ///< most, with voxels no wider than 3 mm; accurate 0)
    double region_margin = -1;  ///< voxels of a level around what the images show, see ImagePyramid::lattice, where
                                ///< they are compared; -1: everywhere
  } pyramid;

  struct Momenta {
    double width_voxels = 0;  ///< kernel width sigma, in reference voxels of each momentum scale; 0: 6, and sums of
                              ///< widths where they are better for model, similarity and noise (core/README.md)
    std::vector<KernelWidth> kernel_widths;  ///< kernel of the scales that have order 0 as a sum of widths; empty:
                                             ///< width_voxels, and where that is 0 what it stands for
    /// While order 0 is alone, its finest scale counts all widths of kernel_widths but the widest a fifth if the
    /// displacement of the next coarser level is simple shear to less than this (simple_shear.h): they are for what is
    /// sharp; 0: never; -1: what was measured, 0 where kernel_widths or width_voxels is given (core/measurements.md,
    /// "Widths").
    double narrow_width_shear = 0;
    /// Where order 0 has settled (at its limit of iterations: by optimisation.tolerance), alone and with all of its
    /// scales, on the level that is as fine as these (the finest one, or one before), it goes on with one more,
    /// Gaussian and 2 (with lncc 3) voxels of the finest scale wide, if the square of what pulls at that is so many
    /// times what noise makes of it, a noise of 1 % of the intensity range at least, and (not with ssd) a tenth (with
    /// mind half) more times than at the finest scale. On a level without first orders less simple shear than
    /// first_order_shear must show. The flow gets closer sites or more map steps for it. 0: never; -1: what was
    /// measured, 0 where kernel_widths, width_voxels or another coarsening is given (core/measurements.md, "Widths").
    double narrower_pull = 0;
    std::vector<KernelWidth> first_order_kernel_widths;  ///< of the scales of order 1 alone; empty: width_voxels
    int scales = 0;         ///< number of order-0 scales, each twice as wide as the next; 0: one a level
    int finest_scale = -1;  ///< q: the finest order-0 scale has 2^q reference voxels; -1: that of the finest level, but
                            ///< where order 0 is Gaussian and the similarity not ssd at least 1 in 2-D, and in 3-D
                            ///< where accurate takes voxels of up to 1.5 mm; at least 1 as well for Wendland1 in 3-D;
                            ///< -2: the next coarser
    double regularisation = 0.01;  ///< weight of 1/2 ||v_0||^2, per mm^2; 0: by similarity, and with ssd
                                   ///< less in 3-D, as measured (core/measurements.md, "Regularisation")
    /// Of each scale of order 0 as a share of that of the next finer one; the finest one's is `regularisation`.
    double coarser_regularisation = 1;
    /// That, once first orders take part; 0: no other, but for auto where the preset is not fast ten times as much with
    /// lncc, three times with mi and ngf and in 2-D twice with mind, but in 3-D, where first orders are asked for, five
    /// times with lncc, once with ngf and half with mind (core/measurements.md, "Regularisation").
    /// Given alone it is that of plain slips as well, and with these three in 3-D more shear is asked of all.
    double regularisation_beside_first = 0;
    /// That instead, where it was a plain slip that let them in: early (plain_shear) or in the end
    /// (settled_plain_shear). 0: no other, but for auto in 3-D, not with fast, ten times that of order 0 alone with
    /// lncc, three times with ngf and once with mind, unless regularisation_beside_first is given.
    double regularisation_beside_plain = 0;
    int first_order_scales = 0;         ///< number of order-1 scales; 0 leaves order 1 out
    int first_order_finest_scale = -1;  ///< of order 1; -1: the finest level's, 1 at least for Wendland1 in 3-D, and
                                        ///< for auto with all but ssd where accurate takes voxels of up to 1.5 mm
    double first_order_regularisation = 0.01;  ///< weight of 1/2 ||v_i||^2, per mm^2
    double sparsity = 0;        ///< lambda of the group L1 on a_1 m_i (a velocity), per mm; -1: as was measured
    double sparsity_noise = 0;  ///< lambda is `sparsity` times 1 + (noise of the finest level's images) / this; 0: it
                                ///< does not follow the noise
    double full_contrast = 0;   ///< of rms_gradient, intensity range a voxel of the finest level: with ssd, where an
                                ///< image has less, lambda, regularisation_beside_first, what is measured of
                                ///< oriented_width and the tolerances of rounds are less; 0: they are not
    int sparsity_path = 1;  ///< weights lambda 2^(n-1), ..., lambda that a level is solved with, one after the other;
                            ///< none where a coarser one found first orders and reweighted_rounds follow, nor where
                            ///< shear_weights take its place
    /// lambda of the rounds with even weights that reweighted ones follow, as a multiple: they are there to show where
    /// momenta are, which a larger one does with fewer of them.
    double even_sparsity = 1;
    /// 1: where first orders wait and oriented momenta are alone, their first weights come from how strongly order 0's
    /// velocity changes, in place of a path of even ones; 2: in place of the first reweighted round as well; -1: what
    /// was measured (core/measurements.md, "First weights from the velocity"), 0 without
    /// reweighted rounds and where the path or its weights are not the usual ones.
    int shear_weights = 0;
    int reweighted_rounds = 0;      ///< times that a level is solved again with weights made from the momenta found
    bool debias = false;            ///< a last round without sparsity on the momenta found
    std::vector<double> direction;  ///< of the derivative of model directional: a unit vector, world (LPS)
    /// On each level order 1 takes part only if the displacement of order 0, settled alone to `tolerance`, to
    /// look_tolerance or, where it is quick, to quick_tolerance, is simple shear to so much, as it is or less what most
    /// of the image does (simple_shear.h); 0: always; -1: what was measured (core/measurements.md, "Only where it
    /// slides").
    double first_order_shear = 0;
    /// With so much of it early on a level order 0 need not settle first; 0: it always does; -1: what was measured
    /// (core/measurements.md, "Only where it slides").
    double plain_shear = 0;
    /// With so much of it a slip is plain as well where order 0 has settled or was quick, for
    /// regularisation_beside_plain; 0: none is; -1: what was measured (core/measurements.md, "Only where it slides").
    double settled_plain_shear = 0;
    /// Where ten iterations had at least this share of what brought order 0, alone, to `tolerance`, it gives up what is
    /// sharp when first orders that waited are let in: each scale's momentum becomes its mean under the scale's kernel.
    /// 0: never; -1: what was measured (core/measurements.md, "Where order 0 begins beside first orders").
    double quick_share = 0;
    /// The same where after at most ten iterations the last five have no more than this share of what all have brought:
    /// whether something slides is asked then, without waiting for order 0 to settle. 0: it is not; -1: what was
    /// measured (core/measurements.md, "Quick before it has settled").
    double quick_tolerance = 0;
    /// Where first orders that do not wait were left out on the finest level and order 0 ends at a coarser scale, it
    /// gets the finer ones as well, settles again and lets first orders in with so much simple shear; 0: it does not;
    /// -1: what was measured (core/measurements.md, "Only where it slides").
    double finer_shear = 0;
    int orientations = 0;          ///< normals that oriented momenta are turned from; 0: there are none of these; -1:
                                   ///< 8 in 2-D and 9 in 3-D, none where there can be none
    double oblique_share = 0;      ///< of an interface must be oblique for oriented momenta to begin; -1: by
                                   ///< similarity and dimension, as measured
    int oriented_alone = 0;        ///< 1: no momenta along the axes join a scale that has turned ones and none of
                                   ///< these; 2: beside a Gaussian order 0 there are oriented ones alone; -1: by
                                   ///< similarity, dimension and contrast, as measured
    double oriented_sparsity = 0;  ///< lambda of oriented momenta, as a share of `sparsity`; 0: by similarity and
                                   ///< dimension, as measured
    /// Width of the kernel of oriented momenta along their normal, as a share of the first orders'; 0: by similarity,
    /// dimension and contrast, as measured (core/measurements.md, "Slip at any orientation").
    double oriented_width = 0;
    bool first_order_waits = false;  ///< on each level order 0 settles before first-order momenta appear
    /// So many blocks of a scale's first-order fields are active at most, where they are sparse, as a share of those
    /// that Dim fields have at full resolution (momenta/block_set.h); of more that want to join those do that pull
    /// hardest.
    /// 0: what suits model and dimension.
    double most_active_share = 1;
    bool shear_only = false;  ///< drop component i of m_i, so that a jump can only slide
  } momenta;

  struct Flow {
    Evolution evolution = Evolution::Carried;
    int time_steps = 4;
    int map_steps = 1;  ///< steps of the map in each time step, see flow/geodesic_shooting.h
    /// Voxels of a level. Above 0 each level takes as many map steps, up to kMostMapSteps, as keep 99.9 % of its sites
    /// from being followed more wrongly than this by the motion found before it; the coarsest map_steps, the finest no
    /// fewer.
    double map_tolerance = 0;
    int coarsening = 0;  ///< order 0 (beside which no order 1 shares its scale), and the flow as long as it is
                         ///< alone, are sampled 2^n times coarser than the images of the level; beside order 1
                         ///< the flow is where that is, see flow_lattice_beside_first
    double divergence_weight = 0;  ///< of 1/2 integral |div v|^2 over space and time: holds back opening and overlap;
                                   ///< -1: by similarity and dimension (core/measurements.md, "Divergence")
  } flow;

  SimilarityOptions similarity_parameters;

  struct Optimisation {
    int max_iterations = 60;  ///< in each round of a level
    double tolerance = 1e-3;  ///< a level ends when five iterations give less than this share of its total decrease
    /// The same of a round with first orders that another one follows, where larger: it is there for the weights that
    /// the next one is made with. It follows the contrast (full_contrast), without `keep_pairs` as lambda does. -1:
    /// what suits model, similarity, preset and dimension (core/measurements.md, "Sparsity").
    double round_tolerance = 0;
    /// The same of a level's first round where a coarser level has found first orders and they do not wait. -1:
    /// round_tolerance; with `keep_pairs` that then follows the contrast, down to `tolerance` as it was given over the
    /// contrast's root.
    double first_round_tolerance = -1;
    /// A round that differs from the one before by the weights of its sparsity, and by how far elements have turned,
    /// begins with the pairs that L-BFGS has. Not after one in which first orders waited, or that found no way down.
    bool keep_pairs = false;
    /// The same of order 0 alone, where smaller: on a level without first orders, or where no slip showed when it had
    /// settled to `tolerance`, before it is asked again; 0: `tolerance`.
    double look_tolerance = 0;
    double optimality_tolerance = 1e-3;  ///< a level ends when the optimality residual is this share of its first
    /// A round without first orders ends when the square of the residual is at most this share of what the images'
    /// noise alone makes of it; 0: does not.
    double noise_tolerance = 0;
    /// Pairs kept by L-BFGS; 0: 4 in 3-D (`Wendland1` 2), and in 2-D 6, with ssd of `sliding` 20 and of `auto` 32, as
    /// measured (core/measurements.md, "Pairs of L-BFGS").
    int history = 0;
  } optimisation;

  int threads = 0;  ///< 0: all that the process may use
};

RegistrationOptions default_options(Model model, SimilarityType similarity, Preset preset);

/// Whether the kernel of order 0 is Gaussian: order 1 then has a kernel, and so scales, of its own.
bool is_zeroth_gaussian(Model model);

/// Whether there may be a scale of order 1 alone, whose kernel first_order_kernel_widths is of. Said for certain of
/// options that are resolved; of others true where that depends on the image.
bool may_have_first_order_alone(const RegistrationOptions& options);

/// One expert parameter, as `--set help` lists it.
struct ParameterInfo {
  std::string name;
  std::string value;  ///< current value in the options it was listed from
  std::string unit;   ///< "" for none
  std::string range;  ///< e.g. "> 0" or "true|false"
  std::string description;
};

std::vector<ParameterInfo> list_parameters(const RegistrationOptions& options);

/// Sets the parameter called `name` from text. Throws InvalidInput naming the parameter, the value and what is allowed.
void set_parameter(RegistrationOptions& options, std::string_view name, std::string_view value);

/// Every reason why `options` cannot be used; empty when all is well.
std::vector<std::string> problems(const RegistrationOptions& options);

/// Everything there is to choose from, in the order in which it is listed to users.
std::vector<Model> all_models();
std::vector<SimilarityType> all_similarities();
std::vector<Preset> all_presets();

std::string to_string(Model model);
std::string to_string(SimilarityType similarity);
std::string to_string(Preset preset);

/// The inverses of to_string. Throw InvalidInput that lists the names there are.
Model parse_model(std::string_view text);
SimilarityType parse_similarity(std::string_view text);
Preset parse_preset(std::string_view text);

}  // namespace saltus
