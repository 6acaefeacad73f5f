#include "server/worker/registration_job.h"

#include "core/image_io/affine_start.h"
#include "core/image_io/slip_surface_io.h"
#include "core/image_io/write_image.h"
#include "core/image_io/write_transform.h"
#include "core/registration/register_images.h"
#include "core/support/errors.h"
#include "core/support/thread_count.h"
#include "server/worker/attempt.h"
#include "server/worker/report/analysis.h"
#include "server/worker/task_inputs.h"

#include <sys/resource.h>

#include <chrono>
#include <exception>
#include <fstream>
#include <functional>
#include <iomanip>
#include <memory>
#include <new>
#include <sstream>
#include <utility>

namespace saltus::worker {
namespace {

namespace fs = std::filesystem;

AffineKind kind_of(AffineStart start) {
  switch (start) {
    case AffineStart::None:
      return AffineKind::None;
    case AffineStart::Rigid:
      return AffineKind::Rigid;
    case AffineStart::Affine:
      return AffineKind::Affine;
  }
  return AffineKind::None;
}

/// "momentum_1_order0", "momentum_3_order1_x", "momentum_5_order1_oriented": numbered as they come, coarse to fine.
template <int Dim>
std::string momentum_name(std::size_t number, const MomentumField<Dim>& momentum) {
  const std::string name = "momentum_" + std::to_string(number);
  if (momentum.axis == MomentumField<Dim>::kZeroth) return name + "_order0";
  if (momentum.axis == MomentumField<Dim>::kOriented) return name + "_order1_oriented";
  return name + "_order1_" + "xyz"[momentum.axis];
}

void write_text(const fs::path& file, const std::string& text) {
  std::ofstream out(file, std::ios::binary);
  out << text;
  out.close();
  if (!out) throw FileError(file.string() + " cannot be written");
}

std::size_t peak_memory_bytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<std::size_t>(usage.ru_maxrss) * 1024;
}

/// What the command line has options for, beside the solver's own: the names are those of `saltus register`.
std::map<std::string, std::string> job_options(const RegistrationTask& task) {
  std::map<std::string, std::string> options;
  if (task.affine == AffineStart::Rigid) options["affine"] = "rigid";
  if (task.affine == AffineStart::Affine) options["affine"] = "affine";
  if (task.intensity_window) {
    std::ostringstream text;
    text << std::setprecision(17) << task.intensity_window->first << ',' << task.intensity_window->second;
    options["intensity-window"] = text.str();
  }
  if (task.crop) {
    std::ostringstream text;
    for (std::size_t axis = 0; axis < task.crop->begin.size(); ++axis)
      text << (axis ? "," : "") << task.crop->begin[axis];
    for (std::size_t axis = 0; axis < task.crop->end.size(); ++axis) text << (axis ? "," : ":") << task.crop->end[axis];
    options["crop"] = text.str();
  }
  if (task.fixed_mask) options["fixed-mask"] = "FIXED_MASK";
  if (task.moving_mask) options["moving-mask"] = "MOVING_MASK";
  return options;
}

/// One registration, from files to files.
template <int Dim>
class Run {
 public:
  Run(const RegistrationTask& task, const fs::path& folder, const TaskObserver& observer,
      const TaskCheckpoints& checkpoints)
      : task_(task),
        inputs_folder_(task.fixed.parent_path()),
        folder_(folder),
        observer_(observer),
        checkpoints_(checkpoints) {}

  std::vector<std::string> operator()() {
    enter(TaskStage::Validating);
    timed("reading", [this] { read(); });
    enter(TaskStage::Optimising);
    if (task_.affine != AffineStart::None)
      timed("affine start", [this] { attempt("INVALID_INPUT", inputs_folder_, [this] { find_start(); }); });
    timed("registration", [this] { attempt("INVALID_INPUT", inputs_folder_, [this] { optimise(); }); });
    if (result_.summary.termination == Termination::Stopped) throw TaskStopped();
    enter(TaskStage::Writing);
    attempt("OUTPUT_UNWRITABLE", folder_, [this] {
      timed("writing", [this] { write_images(); });
      write_reports();
    });
    return names_;
  }

 private:
  void enter(TaskStage stage) const {
    if (observer_(stage, Progress{}) == ProgressAnswer::Stop) throw TaskStopped();
  }

  template <class Part>
  void timed(const std::string& name, const Part& part) {
    const auto begin = std::chrono::steady_clock::now();
    part();
    stage_seconds_[name] = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  }

  void read() {
    attempt("INVALID_OPTIONS", inputs_folder_, [this] { options_ = make_options(task_); });
    inputs_ = read_inputs<Dim>(task_);
  }

  void find_start() {
    RegistrationInput<Dim>& images = inputs_.images;
    const AffineMasks<Dim> masks{images.fixed_mask ? &*images.fixed_mask : nullptr,
                                 images.moving_mask ? &*images.moving_mask : nullptr};
    images.start = find_affine_start(images.fixed, images.moving, kind_of(task_.affine), task_.threads, masks);
  }

  void optimise() {
    inputs_.images.fixed_points = inputs_.landmarks.fixed;
    if (checkpoints_.resume) {
      try {
        return optimise_from([file = *checkpoints_.resume]() -> std::unique_ptr<std::istream> {
          return std::make_unique<std::ifstream>(file, std::ios::binary);
        });
      } catch (const InvalidInput& error) {
        // If the reason lies elsewhere, it comes again.
        if (checkpoints_.on_unfit) checkpoints_.on_unfit(error.what());
      }
    }
    optimise_from({});
  }

  void optimise_from(OpenCheckpoint checkpoint) {
    result_ = register_images(
        inputs_.images, options_,
        [this](const Progress& progress) { return observer_(TaskStage::Optimising, progress); },
        Checkpointing{std::move(checkpoint), checkpoints_.offer});
  }

  fs::path file(const std::string& name) {
    names_.push_back(name);
    return folder_ / name;
  }

  using Files = std::vector<std::pair<fs::path, std::function<void(const fs::path&)>>>;

  /// Calls each function with its path, several at once: they pack side by side, while ITK writes one at a time. What
  /// each holds for itself is far below what the registration held, of which the images and the result are left.
  static void write_at_once(const Files& files) {
    std::vector<std::exception_ptr> failures(files.size());
#pragma omp parallel for schedule(dynamic, 1)
    for (std::size_t i = 0; i < files.size(); ++i) {
      try {
        files[i].second(files[i].first);
      } catch (...) {
        failures[i] = std::current_exception();
      }
    }
    for (const std::exception_ptr& failure : failures)
      if (failure) std::rethrow_exception(failure);
  }

  void write_images() {
    const std::string suffix = "." + (task_.output_format.empty() ? "nii.gz" : task_.output_format);
    const auto vectors = [](const VectorVolume<Dim>& from) {
      return [&from](const fs::path& to) { write_vector_volume(to, from); };
    };
    const auto scalars = [](const Volume<Dim>& from) {
      return [&from](const fs::path& to) { write_volume(to, from); };
    };
    Files files = {
        {file("displacement" + suffix), vectors(result_.displacement)},
        {file("inverse_displacement" + suffix), vectors(result_.inverse_displacement)},
        {file("transform.h5"), [this](const fs::path& to) { write_transform(to, result_.displacement); }},
        {file("warped" + suffix), scalars(result_.warped)},
        {file("jacobian" + suffix), scalars(result_.jacobian)},
        {file("interface.csv"), [this](const fs::path& to) { write_slip_csv(to, result_.slip); }},
        {file("interface.vtp"), [this](const fs::path& to) { write_slip_vtp(to, result_.slip); }},
    };
    for (std::size_t i = 0; i < result_.momenta.size(); ++i)
      files.emplace_back(file(momentum_name(i + 1, result_.momenta[i]) + suffix), vectors(result_.momenta[i].vectors));
    const ThreadCount threads(task_.threads);
    write_at_once(files);
  }

  void write_reports() {
    report::ReportInput<Dim> report;
    report.input = &inputs_.images;
    report.result = &result_;
    report.options = &options_;
    report.fixed_points = inputs_.landmarks.fixed;
    report.moving_points = inputs_.landmarks.moving;
    report.title = "Registration report";
    report.peak_memory_bytes = peak_memory_bytes();
    report.program = "saltus " SALTUS_VERSION;
    report.digests = task_.digests;
    report.job_options = job_options(task_);
    report.stage_seconds = stage_seconds_;
    const ThreadCount threads(task_.threads);
    const auto analysis = report::analyse(report);
    write_text(file("report.json"), report::report_json(report, analysis));
    write_text(file("report.html"), report::report_html(report, analysis));
  }

  const RegistrationTask& task_;
  const fs::path inputs_folder_, folder_;
  const TaskObserver& observer_;
  const TaskCheckpoints& checkpoints_;
  RegistrationOptions options_;
  TaskInputs<Dim> inputs_;
  RegistrationResult<Dim> result_;
  std::map<std::string, double> stage_seconds_;
  std::vector<std::string> names_;
};

}  // namespace

std::vector<std::string> run_registration_task(const RegistrationTask& task, const fs::path& folder,
                                               const TaskObserver& observer, const TaskCheckpoints& checkpoints) {
  try {
    return input_dimension(task) == 2 ? Run<2>(task, folder, observer, checkpoints)()
                                      : Run<3>(task, folder, observer, checkpoints)();
  } catch (const TaskFailure&) {
    throw;
  } catch (const TaskStopped&) {
    throw;
  } catch (const NumericalFailure& error) {
    throw TaskFailure("DIVERGED", error.what());
  } catch (const std::bad_alloc&) {
    throw TaskFailure(
        "MEMORY_LIMIT",
        "the registration needs more memory than it may use; crop the fixed image, set finest_level to 1, "
        "or give the server more memory");
  } catch (const std::exception& error) {
    throw TaskFailure("INTERNAL", std::string("the solver has a fault (") + error.what() + "); please report it");
  }
}

}  // namespace saltus::worker
