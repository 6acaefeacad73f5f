#pragma once

#include "server/store/database.h"

namespace saltus::server {

constexpr int kSchemaVersion = 1;

/// Sets the connection's durability, and creates the tables of a new database. Throws std::runtime_error when the
/// database belongs to something else or to a newer saltusd.
void prepare_schema(Database& database);

}  // namespace saltus::server
