#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>

struct sqlite3;
struct sqlite3_stmt;

namespace saltus::server {

/// SQLite refused. `code` is its primary result code.
class DatabaseError : public std::runtime_error {
 public:
  DatabaseError(int code, const std::string& message) : std::runtime_error(message), code_(code) {}
  int code() const { return code_; }

 private:
  int code_;
};

/// One execution of a prepared statement. Parameters are bound in order, columns read in order.
class Query {
 public:
  explicit Query(sqlite3_stmt* statement) : statement_(statement) {}
  Query(const Query&) = delete;
  Query& operator=(const Query&) = delete;
  ~Query();

  Query& bind(std::int64_t value);
  Query& bind(std::string_view text);
  Query& bind_blob(std::string_view bytes);
  Query& bind_null();
  template <class T>
  Query& bind_optional(const std::optional<T>& value) {
    return value ? bind(*value) : bind_null();
  }

  /// True while there is a row. Throws DatabaseError.
  bool step();
  /// Runs a statement that yields no rows.
  void run();

  std::int64_t integer();
  std::string text();
  bool is_null() const;  ///< of the column that is read next

 private:
  void check(int code);
  sqlite3_stmt* statement_;
  int parameter_ = 0;
  int column_ = 0;
};

/// One connection. One thread at a time.
class Database {
 public:
  enum class Access { ReadWrite, ReadOnly };

  /// Throws DatabaseError.
  Database(const std::filesystem::path& file, Access access);
  ~Database();
  Database(const Database&) = delete;
  Database& operator=(const Database&) = delete;

  /// Statements are prepared once and kept; at most one Query of each text at a time.
  Query query(const char* sql);
  /// Runs any number of statements without parameters or results.
  void execute(const std::string& sql);
  bool is_in_transaction() const;
  int changes() const;  ///< rows changed by the last statement

 private:
  sqlite3* connection_ = nullptr;
  std::map<std::string, sqlite3_stmt*, std::less<>> statements_;
};

}  // namespace saltus::server
