#include "server/rpc/roles.h"

#include "core/support/errors.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

namespace saltus::server {
namespace {

using ::testing::HasSubstr;

TEST(Roles, AreReadLineByLine) {
  const RoleTable table = parse_roles("# who\n\n a@b.c = reader\r\nCN = x, y=submitter,admin\n  node7=worker", "roles");
  EXPECT_EQ(
      table,
      (RoleTable{{"a@b.c", {Role::Reader}}, {"CN = x, y", {Role::Submitter, Role::Admin}}, {"node7", {Role::Worker}}}));
  EXPECT_TRUE(parse_roles("", "roles").empty());
}

TEST(Roles, AnErrorNamesFileAndLine) {
  const std::pair<std::string, std::string> cases[] = {{"a = reader\nb = writer", "roles, line 2: 'writer' is no role"},
                                                       {"a", "roles, line 1: write IDENTITY = ROLE"},
                                                       {"= reader", "write IDENTITY = ROLE"},
                                                       {"a =", "no role is given"},
                                                       {"a = reader,,admin", "'' is no role"},
                                                       {"a = reader\na = admin", "line 2: 'a' was given roles before"},
                                                       {"local = reader", "unix socket"}};
  for (const auto& [text, said] : cases) {
    SCOPED_TRACE(text);
    try {
      parse_roles(text, "roles");
      FAIL() << "was accepted";
    } catch (const InvalidInput& error) {
      EXPECT_THAT(error.what(), HasSubstr(said));
    }
  }
}

TEST(RolesFile, KeepsTheRolesWhenAChangeHasAnError) {
  const testing_support::TemporaryFolder folder;
  std::vector<std::string> logged;
  RolesFile roles(folder.write("roles", "a = reader"), [&](const std::string& line) { logged.push_back(line); });
  roles.reload_if_changed();
  EXPECT_TRUE(logged.empty());
  EXPECT_EQ(roles.roles_of("a"), Roles{Role::Reader});
  EXPECT_EQ(roles.roles_of("b"), std::nullopt);

  folder.write("roles", "a = reader\nb = everything");
  roles.reload_if_changed();
  ASSERT_EQ(logged.size(), 1u);
  EXPECT_THAT(logged[0], HasSubstr("line 2"));
  EXPECT_EQ(roles.roles_of("a"), Roles{Role::Reader});

  std::filesystem::remove(folder / "roles");
  roles.reload_if_changed();
  ASSERT_EQ(logged.size(), 2u);
  EXPECT_EQ(roles.roles_of("a"), Roles{Role::Reader});

  folder.write("roles", "b = admin, worker");
  roles.reload_if_changed();
  EXPECT_EQ(roles.roles_of("a"), std::nullopt);
  EXPECT_EQ(roles.roles_of("b"), (Roles{Role::Admin, Role::Worker}));
}

TEST(RolesFile, RefusesAFileThatCannotBeRead) {
  EXPECT_THROW(RolesFile("/nowhere/roles", [](const std::string&) {}), InvalidInput);
}

}  // namespace
}  // namespace saltus::server
