#include "client/cli/job_output.h"

#include "core/support/errors.h"

#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

namespace saltus::cli {
namespace {

using testing::HasSubstr;

v1::RegistrationJob running_job() {
  v1::RegistrationJob job;
  job.set_id("job-1");
  job.set_state(v1::JOB_STATE_RUNNING);
  job.set_attempt(2);
  job.mutable_spec()->set_model("sliding");
  job.mutable_spec()->set_affine(v1::AFFINE_START_RIGID);
  (*job.mutable_spec()->mutable_settings())["time_steps"] = "7";
  job.mutable_progress()->set_stage(v1::JOB_STAGE_OPTIMISING);
  job.mutable_progress()->set_fraction(0.25);
  job.mutable_progress()->set_seconds_left(-1);
  job.mutable_create_time()->set_seconds(86400);
  job.mutable_create_time()->set_nanos(999);
  return job;
}

TEST(States, AreNamedWithoutPrefixAndReadBack) {
  EXPECT_EQ(state_name(v1::JOB_STATE_CANCELLING), "CANCELLING");
  EXPECT_EQ(parse_state("running"), v1::JOB_STATE_RUNNING);
  EXPECT_EQ(parse_state("FAILED"), v1::JOB_STATE_FAILED);
  EXPECT_THAT([] { parse_state("done"); },
              testing::ThrowsMessage<InvalidInput>(testing::AllOf(HasSubstr("done"), HasSubstr("succeeded"))));
  EXPECT_EQ(stage_name(v1::JOB_STAGE_WRITING), "writing");
  EXPECT_EQ(stage_name(v1::JOB_STAGE_UNSPECIFIED), "starting");
}

TEST(JobJson, HoldsWhatIsKnownAndNothingElse) {
  const nlohmann::json json = job_json(running_job());
  EXPECT_EQ(json["id"], "job-1");
  EXPECT_EQ(json["state"], "RUNNING");
  EXPECT_EQ(json["attempt"], 2);
  EXPECT_EQ(json["spec"]["settings"]["time_steps"], "7");
  EXPECT_EQ(json["spec"]["affine"], "rigid");
  EXPECT_EQ(json["progress"]["stage"], "optimising");
  EXPECT_EQ(json["progress"]["fraction"], 0.25);
  EXPECT_EQ(json["create_time"], "1970-01-02T00:00:00Z");
  for (const char* absent : {"failure", "artifacts", "end_time", "queue_position"}) EXPECT_FALSE(json.contains(absent));
  EXPECT_FALSE(json["progress"].contains("seconds_left")) << "-1 means unknown";
}

TEST(JobJson, TellsSizesAsNumbers) {
  v1::RegistrationJob job = running_job();
  job.set_state(v1::JOB_STATE_SUCCEEDED);
  v1::Artifact* artifact = job.add_artifacts();
  artifact->set_name("warped.mha");
  artifact->set_size(5'000'000'000);
  EXPECT_EQ(job_json(job)["artifacts"][0]["size"], 5'000'000'000);
}

TEST(JobTable, HasALineForEachJob) {
  v1::RegistrationJob failed = running_job();
  failed.set_state(v1::JOB_STATE_FAILED);
  const std::string table = job_table({running_job(), failed});
  EXPECT_EQ(std::count(table.begin(), table.end(), '\n'), 3);
  EXPECT_THAT(table, HasSubstr("25 %"));
  EXPECT_THAT(table, HasSubstr("FAILED"));
}

TEST(JobText, NamesTheFailure) {
  v1::RegistrationJob job = running_job();
  job.set_state(v1::JOB_STATE_FAILED);
  job.mutable_failure()->set_reason("GEOMETRY_MISMATCH");
  job.mutable_failure()->set_message("the images differ");
  EXPECT_THAT(job_text(job), HasSubstr("GEOMETRY_MISMATCH: the images differ"));
  EXPECT_EQ(failure_line(job), "job job-1 failed (GEOMETRY_MISMATCH): the images differ");
  job.set_state(v1::JOB_STATE_CANCELLED);
  EXPECT_EQ(failure_line(job), "job job-1 was cancelled");
}

TEST(JobText, OfOneInABatchSystemSaysWhatItWaitsFor) {
  v1::RegistrationJob job;
  job.set_state(v1::JOB_STATE_RUNNING);
  job.mutable_progress()->set_stage(v1::JOB_STAGE_WAITING);
  EXPECT_THAT(job_text(job), testing::Not(HasSubstr("waits for")));
  job.mutable_progress()->set_waiting_for("ReqNodeNotAvail, UnavailableNodes:node3");
  EXPECT_THAT(job_text(job), HasSubstr("\nwaits for:  ReqNodeNotAvail, UnavailableNodes:node3\n"));
  EXPECT_EQ(job_json(job)["progress"]["waiting_for"], "ReqNodeNotAvail, UnavailableNodes:node3");
}

}  // namespace
}  // namespace saltus::cli
