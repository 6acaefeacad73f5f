#pragma once

#include "server/store/database.h"

namespace saltus::server {

/// The schema that this program reads and writes: the number of migrations in schema.cpp.
constexpr int kSchemaVersion = 6;

/// Sets the connection's durability and brings the database to `version`: one migration after the other, each in a
/// transaction of its own that also sets user_version, so that a crash in between leaves a database of some whole
/// version. A new database goes the same way from nothing. Throws std::runtime_error when the database belongs to
/// something else or to a newer saltusd; nothing is changed then.
void prepare_schema(Database& database, int version = kSchemaVersion);

}  // namespace saltus::server
