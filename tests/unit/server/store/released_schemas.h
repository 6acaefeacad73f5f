#pragma once

/// A database of every schema, with rows in every table, as `sqlite3 saltusd.db .dump` shows them. No daemon of that
/// time has written them: they were made with the migrations up to each schema when this list was begun, which shows
/// that later migrations carry them over, not that an old daemon has made the same. Never to be edited: a new schema
/// gets a fixture of its own.
namespace saltus::testing_support {

// Jobs, their labels and inputs, blobs.
constexpr const char* kReleasedSchema1 = R"sql(
PRAGMA foreign_keys=OFF;
BEGIN TRANSACTION;
CREATE TABLE blob (
  digest TEXT PRIMARY KEY,
  size INTEGER NOT NULL,
  created INTEGER NOT NULL
) WITHOUT ROWID;
INSERT INTO blob VALUES('sha256:in',10,1000);
INSERT INTO blob VALUES('sha256:out',20,2000);
CREATE TABLE job (
  sequence INTEGER PRIMARY KEY AUTOINCREMENT,
  revision INTEGER NOT NULL,
  id TEXT NOT NULL UNIQUE,
  request_id TEXT UNIQUE,
  request_hash TEXT NOT NULL,
  spec BLOB NOT NULL,
  threads INTEGER NOT NULL,
  state INTEGER NOT NULL,
  attempt INTEGER NOT NULL,
  lost_attempts INTEGER NOT NULL,
  crashes INTEGER NOT NULL,
  token_hash TEXT NOT NULL,
  process TEXT NOT NULL,
  created INTEGER NOT NULL,
  started INTEGER,
  ended INTEGER,
  failure_reason TEXT,
  failure_message TEXT
);
INSERT INTO job VALUES(3,3,'done','request-1','hash-1',X'00ff73706563',2,3,1,0,0,'token','',1000,2000,3000,NULL,NULL);
INSERT INTO job VALUES(4,4,'failed',NULL,'hash-2',X'73706563',0,4,2,1,1,'token','',1001,2001,3001,'DIVERGED','it diverged');
INSERT INTO job VALUES(7,2,'running','request-2','hash-3',X'73706563',0,1,1,0,0,'token','42 1 boot',1002,2002,NULL,NULL,NULL);
CREATE TABLE label (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  name TEXT NOT NULL,
  value TEXT NOT NULL,
  PRIMARY KEY (job, name)
) WITHOUT ROWID;
INSERT INTO label VALUES(3,'case','7');
INSERT INTO label VALUES(3,'side','left');
CREATE TABLE input (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  digest TEXT NOT NULL REFERENCES blob,
  PRIMARY KEY (job, digest)
) WITHOUT ROWID;
INSERT INTO input VALUES(3,'sha256:in');
INSERT INTO input VALUES(7,'sha256:in');
CREATE TABLE artifact (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  position INTEGER NOT NULL,
  name TEXT NOT NULL,
  digest TEXT NOT NULL REFERENCES blob,
  size INTEGER NOT NULL,
  PRIMARY KEY (job, position)
) WITHOUT ROWID;
INSERT INTO artifact VALUES(3,0,'field.nii.gz','sha256:out',20);
DELETE FROM sqlite_sequence;
INSERT INTO sqlite_sequence VALUES('job',12);
CREATE INDEX job_by_state ON job (state, sequence);
CREATE INDEX input_by_digest ON input (digest);
CREATE INDEX artifact_by_digest ON artifact (digest);
PRAGMA application_id=1936487541;
PRAGMA user_version=1;
COMMIT;
)sql";

// Submitters, priorities, limits, retries and checkpoints.
constexpr const char* kReleasedSchema2 = R"sql(
PRAGMA foreign_keys=OFF;
BEGIN TRANSACTION;
CREATE TABLE blob (
  digest TEXT PRIMARY KEY,
  size INTEGER NOT NULL,
  created INTEGER NOT NULL
) WITHOUT ROWID;
INSERT INTO blob VALUES('sha256:in',10,1000);
INSERT INTO blob VALUES('sha256:out',20,2000);
INSERT INTO blob VALUES('sha256:stand',30,2500);
CREATE TABLE label (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  name TEXT NOT NULL,
  value TEXT NOT NULL,
  PRIMARY KEY (job, name)
) WITHOUT ROWID;
INSERT INTO label VALUES(3,'case','7');
INSERT INTO label VALUES(8,'case','8');
INSERT INTO label VALUES(3,'side','left');
CREATE TABLE input (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  digest TEXT NOT NULL REFERENCES blob,
  PRIMARY KEY (job, digest)
) WITHOUT ROWID;
INSERT INTO input VALUES(3,'sha256:in');
INSERT INTO input VALUES(8,'sha256:in');
INSERT INTO input VALUES(9,'sha256:in');
CREATE TABLE artifact (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  position INTEGER NOT NULL,
  name TEXT NOT NULL,
  digest TEXT NOT NULL REFERENCES blob,
  size INTEGER NOT NULL,
  PRIMARY KEY (job, position)
) WITHOUT ROWID;
INSERT INTO artifact VALUES(3,0,'field.nii.gz','sha256:out',20);
CREATE TABLE "job" (
  sequence INTEGER PRIMARY KEY AUTOINCREMENT,
  revision INTEGER NOT NULL,
  id TEXT NOT NULL UNIQUE,
  submitter TEXT NOT NULL DEFAULT 'local',
  request_id TEXT,
  request_hash TEXT NOT NULL,
  spec BLOB NOT NULL,
  threads INTEGER NOT NULL,
  priority INTEGER NOT NULL DEFAULT 1,
  memory_bytes INTEGER NOT NULL DEFAULT 0,
  limit_wall_seconds INTEGER NOT NULL DEFAULT 0,
  limit_cpu_seconds INTEGER NOT NULL DEFAULT 0,
  limit_memory_bytes INTEGER NOT NULL DEFAULT 0,
  state INTEGER NOT NULL,
  attempt INTEGER NOT NULL,
  lost_attempts INTEGER NOT NULL,
  crashes INTEGER NOT NULL,
  not_before INTEGER,
  loss_reason TEXT,
  loss_message TEXT,
  token_hash TEXT NOT NULL,
  process TEXT NOT NULL,
  created INTEGER NOT NULL,
  started INTEGER,
  ended INTEGER,
  failure_reason TEXT,
  failure_message TEXT,
  UNIQUE (submitter, request_id)
);
INSERT INTO job VALUES(3,3,'done','local','request-1','hash-1',X'00ff73706563',2,1,0,0,0,0,3,1,0,0,NULL,NULL,NULL,'token','',1000,2000,3000,NULL,NULL);
INSERT INTO job VALUES(4,4,'failed','local',NULL,'hash-2',X'73706563',0,1,0,0,0,0,4,2,1,1,NULL,NULL,NULL,'token','',1001,2001,3001,'DIVERGED','it diverged');
INSERT INTO job VALUES(8,5,'retry','ann','request-1','hash-4',X'73706563',3,2,1073741824,60,50,2147483648,0,2,1,1,9000,'STALLED','it stood still','token','',1003,2003,NULL,NULL,NULL);
INSERT INTO job VALUES(9,2,'held','bob',NULL,'hash-5',X'73706563',0,0,0,0,0,0,2,1,0,0,NULL,NULL,NULL,'token','43 1 boot',1004,2004,NULL,NULL,NULL);
CREATE TABLE checkpoint (
  job INTEGER PRIMARY KEY REFERENCES job ON DELETE CASCADE,
  digest TEXT NOT NULL REFERENCES blob,
  size INTEGER NOT NULL,
  attempt INTEGER NOT NULL,
  level INTEGER NOT NULL,
  iteration INTEGER NOT NULL
);
INSERT INTO checkpoint VALUES(8,'sha256:stand',30,1,2,17);
DELETE FROM sqlite_sequence;
INSERT INTO sqlite_sequence VALUES('job',12);
CREATE INDEX input_by_digest ON input (digest);
CREATE INDEX artifact_by_digest ON artifact (digest);
CREATE INDEX job_by_state ON job (state, sequence);
CREATE INDEX job_by_submitter ON job (submitter, sequence);
CREATE INDEX queued_by_submitter ON job (submitter) WHERE state = 0;
CREATE INDEX label_by_value ON label (name, value, job);
CREATE INDEX checkpoint_by_digest ON checkpoint (digest);
PRAGMA application_id=1936487541;
PRAGMA user_version=2;
COMMIT;
)sql";

// Since when nobody has referred to a blob.
constexpr const char* kReleasedSchema3 = R"sql(
PRAGMA foreign_keys=OFF;
BEGIN TRANSACTION;
CREATE TABLE blob (
  digest TEXT PRIMARY KEY,
  size INTEGER NOT NULL,
  created INTEGER NOT NULL
, unreferenced_since INTEGER) WITHOUT ROWID;
INSERT INTO blob VALUES('sha256:in',10,1000,NULL);
INSERT INTO blob VALUES('sha256:old',40,500,7000);
INSERT INTO blob VALUES('sha256:out',20,2000,NULL);
INSERT INTO blob VALUES('sha256:stand',30,2500,NULL);
CREATE TABLE label (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  name TEXT NOT NULL,
  value TEXT NOT NULL,
  PRIMARY KEY (job, name)
) WITHOUT ROWID;
INSERT INTO label VALUES(3,'case','7');
INSERT INTO label VALUES(8,'case','8');
INSERT INTO label VALUES(3,'side','left');
CREATE TABLE input (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  digest TEXT NOT NULL REFERENCES blob,
  PRIMARY KEY (job, digest)
) WITHOUT ROWID;
INSERT INTO input VALUES(3,'sha256:in');
INSERT INTO input VALUES(8,'sha256:in');
INSERT INTO input VALUES(9,'sha256:in');
CREATE TABLE artifact (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  position INTEGER NOT NULL,
  name TEXT NOT NULL,
  digest TEXT NOT NULL REFERENCES blob,
  size INTEGER NOT NULL,
  PRIMARY KEY (job, position)
) WITHOUT ROWID;
INSERT INTO artifact VALUES(3,0,'field.nii.gz','sha256:out',20);
CREATE TABLE "job" (
  sequence INTEGER PRIMARY KEY AUTOINCREMENT,
  revision INTEGER NOT NULL,
  id TEXT NOT NULL UNIQUE,
  submitter TEXT NOT NULL DEFAULT 'local',
  request_id TEXT,
  request_hash TEXT NOT NULL,
  spec BLOB NOT NULL,
  threads INTEGER NOT NULL,
  priority INTEGER NOT NULL DEFAULT 1,
  memory_bytes INTEGER NOT NULL DEFAULT 0,
  limit_wall_seconds INTEGER NOT NULL DEFAULT 0,
  limit_cpu_seconds INTEGER NOT NULL DEFAULT 0,
  limit_memory_bytes INTEGER NOT NULL DEFAULT 0,
  state INTEGER NOT NULL,
  attempt INTEGER NOT NULL,
  lost_attempts INTEGER NOT NULL,
  crashes INTEGER NOT NULL,
  not_before INTEGER,
  loss_reason TEXT,
  loss_message TEXT,
  token_hash TEXT NOT NULL,
  process TEXT NOT NULL,
  created INTEGER NOT NULL,
  started INTEGER,
  ended INTEGER,
  failure_reason TEXT,
  failure_message TEXT,
  UNIQUE (submitter, request_id)
);
INSERT INTO job VALUES(3,3,'done','local','request-1','hash-1',X'00ff73706563',2,1,0,0,0,0,3,1,0,0,NULL,NULL,NULL,'token','',1000,2000,3000,NULL,NULL);
INSERT INTO job VALUES(4,4,'failed','local',NULL,'hash-2',X'73706563',0,1,0,0,0,0,4,2,1,1,NULL,NULL,NULL,'token','',1001,2001,3001,'DIVERGED','it diverged');
INSERT INTO job VALUES(8,5,'retry','ann','request-1','hash-4',X'73706563',3,2,1073741824,60,50,2147483648,0,2,1,1,9000,'STALLED','it stood still','token','',1003,2003,NULL,NULL,NULL);
INSERT INTO job VALUES(9,2,'held','bob',NULL,'hash-5',X'73706563',0,0,0,0,0,0,2,1,0,0,NULL,NULL,NULL,'token','43 1 boot',1004,2004,NULL,NULL,NULL);
CREATE TABLE checkpoint (
  job INTEGER PRIMARY KEY REFERENCES job ON DELETE CASCADE,
  digest TEXT NOT NULL REFERENCES blob,
  size INTEGER NOT NULL,
  attempt INTEGER NOT NULL,
  level INTEGER NOT NULL,
  iteration INTEGER NOT NULL
);
INSERT INTO checkpoint VALUES(8,'sha256:stand',30,1,2,17);
DELETE FROM sqlite_sequence;
INSERT INTO sqlite_sequence VALUES('job',12);
CREATE INDEX input_by_digest ON input (digest);
CREATE INDEX artifact_by_digest ON artifact (digest);
CREATE INDEX job_by_state ON job (state, sequence);
CREATE INDEX job_by_submitter ON job (submitter, sequence);
CREATE INDEX queued_by_submitter ON job (submitter) WHERE state = 0;
CREATE INDEX label_by_value ON label (name, value, job);
CREATE INDEX checkpoint_by_digest ON checkpoint (digest);
CREATE INDEX blob_by_unreferenced ON blob (unreferenced_since) WHERE unreferenced_since IS NOT NULL;
CREATE INDEX job_by_end ON job (ended) WHERE ended IS NOT NULL;
PRAGMA application_id=1936487541;
PRAGMA user_version=3;
COMMIT;
)sql";

// Whose quota a blob counts against.
constexpr const char* kReleasedSchema4 = R"sql(
PRAGMA foreign_keys=OFF;
BEGIN TRANSACTION;
CREATE TABLE blob (
  digest TEXT PRIMARY KEY,
  size INTEGER NOT NULL,
  created INTEGER NOT NULL
, unreferenced_since INTEGER, owner TEXT NOT NULL DEFAULT '') WITHOUT ROWID;
INSERT INTO blob VALUES('sha256:in',10,1000,NULL,'ann');
INSERT INTO blob VALUES('sha256:old',40,500,7000,'ann');
INSERT INTO blob VALUES('sha256:out',20,2000,NULL,'');
INSERT INTO blob VALUES('sha256:stand',30,2500,NULL,'');
CREATE TABLE label (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  name TEXT NOT NULL,
  value TEXT NOT NULL,
  PRIMARY KEY (job, name)
) WITHOUT ROWID;
INSERT INTO label VALUES(3,'case','7');
INSERT INTO label VALUES(8,'case','8');
INSERT INTO label VALUES(3,'side','left');
CREATE TABLE input (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  digest TEXT NOT NULL REFERENCES blob,
  PRIMARY KEY (job, digest)
) WITHOUT ROWID;
INSERT INTO input VALUES(3,'sha256:in');
INSERT INTO input VALUES(8,'sha256:in');
INSERT INTO input VALUES(9,'sha256:in');
CREATE TABLE artifact (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  position INTEGER NOT NULL,
  name TEXT NOT NULL,
  digest TEXT NOT NULL REFERENCES blob,
  size INTEGER NOT NULL,
  PRIMARY KEY (job, position)
) WITHOUT ROWID;
INSERT INTO artifact VALUES(3,0,'field.nii.gz','sha256:out',20);
CREATE TABLE "job" (
  sequence INTEGER PRIMARY KEY AUTOINCREMENT,
  revision INTEGER NOT NULL,
  id TEXT NOT NULL UNIQUE,
  submitter TEXT NOT NULL DEFAULT 'local',
  request_id TEXT,
  request_hash TEXT NOT NULL,
  spec BLOB NOT NULL,
  threads INTEGER NOT NULL,
  priority INTEGER NOT NULL DEFAULT 1,
  memory_bytes INTEGER NOT NULL DEFAULT 0,
  limit_wall_seconds INTEGER NOT NULL DEFAULT 0,
  limit_cpu_seconds INTEGER NOT NULL DEFAULT 0,
  limit_memory_bytes INTEGER NOT NULL DEFAULT 0,
  state INTEGER NOT NULL,
  attempt INTEGER NOT NULL,
  lost_attempts INTEGER NOT NULL,
  crashes INTEGER NOT NULL,
  not_before INTEGER,
  loss_reason TEXT,
  loss_message TEXT,
  token_hash TEXT NOT NULL,
  process TEXT NOT NULL,
  created INTEGER NOT NULL,
  started INTEGER,
  ended INTEGER,
  failure_reason TEXT,
  failure_message TEXT,
  UNIQUE (submitter, request_id)
);
INSERT INTO job VALUES(3,3,'done','local','request-1','hash-1',X'00ff73706563',2,1,0,0,0,0,3,1,0,0,NULL,NULL,NULL,'token','',1000,2000,3000,NULL,NULL);
INSERT INTO job VALUES(4,4,'failed','local',NULL,'hash-2',X'73706563',0,1,0,0,0,0,4,2,1,1,NULL,NULL,NULL,'token','',1001,2001,3001,'DIVERGED','it diverged');
INSERT INTO job VALUES(8,5,'retry','ann','request-1','hash-4',X'73706563',3,2,1073741824,60,50,2147483648,0,2,1,1,9000,'STALLED','it stood still','token','',1003,2003,NULL,NULL,NULL);
INSERT INTO job VALUES(9,2,'held','bob',NULL,'hash-5',X'73706563',0,0,0,0,0,0,2,1,0,0,NULL,NULL,NULL,'token','43 1 boot',1004,2004,NULL,NULL,NULL);
CREATE TABLE checkpoint (
  job INTEGER PRIMARY KEY REFERENCES job ON DELETE CASCADE,
  digest TEXT NOT NULL REFERENCES blob,
  size INTEGER NOT NULL,
  attempt INTEGER NOT NULL,
  level INTEGER NOT NULL,
  iteration INTEGER NOT NULL
);
INSERT INTO checkpoint VALUES(8,'sha256:stand',30,1,2,17);
DELETE FROM sqlite_sequence;
INSERT INTO sqlite_sequence VALUES('job',12);
CREATE INDEX input_by_digest ON input (digest);
CREATE INDEX artifact_by_digest ON artifact (digest);
CREATE INDEX job_by_state ON job (state, sequence);
CREATE INDEX job_by_submitter ON job (submitter, sequence);
CREATE INDEX queued_by_submitter ON job (submitter) WHERE state = 0;
CREATE INDEX label_by_value ON label (name, value, job);
CREATE INDEX checkpoint_by_digest ON checkpoint (digest);
CREATE INDEX blob_by_unreferenced ON blob (unreferenced_since) WHERE unreferenced_since IS NOT NULL;
CREATE INDEX job_by_end ON job (ended) WHERE ended IS NOT NULL;
CREATE INDEX blob_by_owner ON blob (owner, size) WHERE owner <> '';
PRAGMA application_id=1936487541;
PRAGMA user_version=4;
COMMIT;
)sql";

// What a batch system calls an attempt, and when it let the worker begin.
constexpr const char* kReleasedSchema5 = R"sql(
PRAGMA foreign_keys=OFF;
BEGIN TRANSACTION;
CREATE TABLE blob (
  digest TEXT PRIMARY KEY,
  size INTEGER NOT NULL,
  created INTEGER NOT NULL
, unreferenced_since INTEGER, owner TEXT NOT NULL DEFAULT '') WITHOUT ROWID;
INSERT INTO blob VALUES('sha256:in',10,1000,NULL,'ann');
INSERT INTO blob VALUES('sha256:old',40,500,7000,'ann');
INSERT INTO blob VALUES('sha256:out',20,2000,NULL,'');
INSERT INTO blob VALUES('sha256:stand',30,2500,NULL,'');
CREATE TABLE label (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  name TEXT NOT NULL,
  value TEXT NOT NULL,
  PRIMARY KEY (job, name)
) WITHOUT ROWID;
INSERT INTO label VALUES(3,'case','7');
INSERT INTO label VALUES(8,'case','8');
INSERT INTO label VALUES(3,'side','left');
CREATE TABLE input (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  digest TEXT NOT NULL REFERENCES blob,
  PRIMARY KEY (job, digest)
) WITHOUT ROWID;
INSERT INTO input VALUES(3,'sha256:in');
INSERT INTO input VALUES(8,'sha256:in');
INSERT INTO input VALUES(9,'sha256:in');
CREATE TABLE artifact (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  position INTEGER NOT NULL,
  name TEXT NOT NULL,
  digest TEXT NOT NULL REFERENCES blob,
  size INTEGER NOT NULL,
  PRIMARY KEY (job, position)
) WITHOUT ROWID;
INSERT INTO artifact VALUES(3,0,'field.nii.gz','sha256:out',20);
CREATE TABLE IF NOT EXISTS "job" (
  sequence INTEGER PRIMARY KEY AUTOINCREMENT,
  revision INTEGER NOT NULL,
  id TEXT NOT NULL UNIQUE,
  submitter TEXT NOT NULL DEFAULT 'local',
  request_id TEXT,
  request_hash TEXT NOT NULL,
  spec BLOB NOT NULL,
  threads INTEGER NOT NULL,
  priority INTEGER NOT NULL DEFAULT 1,
  memory_bytes INTEGER NOT NULL DEFAULT 0,
  limit_wall_seconds INTEGER NOT NULL DEFAULT 0,
  limit_cpu_seconds INTEGER NOT NULL DEFAULT 0,
  limit_memory_bytes INTEGER NOT NULL DEFAULT 0,
  state INTEGER NOT NULL,
  attempt INTEGER NOT NULL,
  lost_attempts INTEGER NOT NULL,
  crashes INTEGER NOT NULL,
  not_before INTEGER,
  loss_reason TEXT,
  loss_message TEXT,
  token_hash TEXT NOT NULL,
  process TEXT NOT NULL,
  created INTEGER NOT NULL,
  started INTEGER,
  ended INTEGER,
  failure_reason TEXT,
  failure_message TEXT, batch_id TEXT NOT NULL DEFAULT '', begun INTEGER,
  UNIQUE (submitter, request_id)
);
INSERT INTO job VALUES(3,3,'done','local','request-1','hash-1',X'00ff73706563',2,1,0,0,0,0,3,1,0,0,NULL,NULL,NULL,'token','',1000,2000,3000,NULL,NULL,'',NULL);
INSERT INTO job VALUES(4,4,'failed','local',NULL,'hash-2',X'73706563',0,1,0,0,0,0,4,2,1,1,NULL,NULL,NULL,'token','',1001,2001,3001,'DIVERGED','it diverged','',NULL);
INSERT INTO job VALUES(8,5,'retry','ann','request-1','hash-4',X'73706563',3,2,1073741824,60,50,2147483648,0,2,1,1,9000,'STALLED','it stood still','token','',1003,2003,NULL,NULL,NULL,'',NULL);
INSERT INTO job VALUES(9,2,'held','bob',NULL,'hash-5',X'73706563',0,0,0,0,0,0,2,1,0,0,NULL,NULL,NULL,'token','43 1 boot',1004,2004,NULL,NULL,NULL,'77',2504);
CREATE TABLE checkpoint (
  job INTEGER PRIMARY KEY REFERENCES job ON DELETE CASCADE,
  digest TEXT NOT NULL REFERENCES blob,
  size INTEGER NOT NULL,
  attempt INTEGER NOT NULL,
  level INTEGER NOT NULL,
  iteration INTEGER NOT NULL
);
INSERT INTO checkpoint VALUES(8,'sha256:stand',30,1,2,17);
DELETE FROM sqlite_sequence;
INSERT INTO sqlite_sequence VALUES('job',12);
CREATE INDEX input_by_digest ON input (digest);
CREATE INDEX artifact_by_digest ON artifact (digest);
CREATE INDEX job_by_state ON job (state, sequence);
CREATE INDEX job_by_submitter ON job (submitter, sequence);
CREATE INDEX queued_by_submitter ON job (submitter) WHERE state = 0;
CREATE INDEX label_by_value ON label (name, value, job);
CREATE INDEX checkpoint_by_digest ON checkpoint (digest);
CREATE INDEX blob_by_unreferenced ON blob (unreferenced_since) WHERE unreferenced_since IS NOT NULL;
CREATE INDEX job_by_end ON job (ended) WHERE ended IS NOT NULL;
CREATE INDEX blob_by_owner ON blob (owner, size) WHERE owner <> '';
PRAGMA application_id=1936487541;
PRAGMA user_version=5;
COMMIT;
)sql";

// Where a batch system runs an attempt, and the attempts that were lost.
constexpr const char* kReleasedSchema6 = R"sql(
PRAGMA foreign_keys=OFF;
BEGIN TRANSACTION;
CREATE TABLE blob (
  digest TEXT PRIMARY KEY,
  size INTEGER NOT NULL,
  created INTEGER NOT NULL
, unreferenced_since INTEGER, owner TEXT NOT NULL DEFAULT '') WITHOUT ROWID;
INSERT INTO blob VALUES('sha256:in',10,1000,NULL,'ann');
INSERT INTO blob VALUES('sha256:old',40,500,7000,'ann');
INSERT INTO blob VALUES('sha256:out',20,2000,NULL,'');
INSERT INTO blob VALUES('sha256:stand',30,2500,NULL,'');
CREATE TABLE label (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  name TEXT NOT NULL,
  value TEXT NOT NULL,
  PRIMARY KEY (job, name)
) WITHOUT ROWID;
INSERT INTO label VALUES(3,'case','7');
INSERT INTO label VALUES(8,'case','8');
INSERT INTO label VALUES(3,'side','left');
CREATE TABLE input (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  digest TEXT NOT NULL REFERENCES blob,
  PRIMARY KEY (job, digest)
) WITHOUT ROWID;
INSERT INTO input VALUES(3,'sha256:in');
INSERT INTO input VALUES(8,'sha256:in');
INSERT INTO input VALUES(9,'sha256:in');
CREATE TABLE artifact (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  position INTEGER NOT NULL,
  name TEXT NOT NULL,
  digest TEXT NOT NULL REFERENCES blob,
  size INTEGER NOT NULL,
  PRIMARY KEY (job, position)
) WITHOUT ROWID;
INSERT INTO artifact VALUES(3,0,'field.nii.gz','sha256:out',20);
CREATE TABLE IF NOT EXISTS "job" (
  sequence INTEGER PRIMARY KEY AUTOINCREMENT,
  revision INTEGER NOT NULL,
  id TEXT NOT NULL UNIQUE,
  submitter TEXT NOT NULL DEFAULT 'local',
  request_id TEXT,
  request_hash TEXT NOT NULL,
  spec BLOB NOT NULL,
  threads INTEGER NOT NULL,
  priority INTEGER NOT NULL DEFAULT 1,
  memory_bytes INTEGER NOT NULL DEFAULT 0,
  limit_wall_seconds INTEGER NOT NULL DEFAULT 0,
  limit_cpu_seconds INTEGER NOT NULL DEFAULT 0,
  limit_memory_bytes INTEGER NOT NULL DEFAULT 0,
  state INTEGER NOT NULL,
  attempt INTEGER NOT NULL,
  lost_attempts INTEGER NOT NULL,
  crashes INTEGER NOT NULL,
  not_before INTEGER,
  loss_reason TEXT,
  loss_message TEXT,
  token_hash TEXT NOT NULL,
  process TEXT NOT NULL,
  created INTEGER NOT NULL,
  started INTEGER,
  ended INTEGER,
  failure_reason TEXT,
  failure_message TEXT, batch_id TEXT NOT NULL DEFAULT '', begun INTEGER, batch_host TEXT NOT NULL DEFAULT '',
  UNIQUE (submitter, request_id)
);
INSERT INTO job VALUES(3,3,'done','local','request-1','hash-1',X'00ff73706563',2,1,0,0,0,0,3,1,0,0,NULL,NULL,NULL,'token','',1000,2000,3000,NULL,NULL,'',NULL,'');
INSERT INTO job VALUES(4,4,'failed','local',NULL,'hash-2',X'73706563',0,1,0,0,0,0,4,2,1,1,NULL,NULL,NULL,'token','',1001,2001,3001,'DIVERGED','it diverged','',NULL,'');
INSERT INTO job VALUES(8,5,'retry','ann','request-1','hash-4',X'73706563',3,2,1073741824,60,50,2147483648,0,2,1,1,9000,'STALLED','it stood still','token','',1003,2003,NULL,NULL,NULL,'',NULL,'');
INSERT INTO job VALUES(9,2,'held','bob',NULL,'hash-5',X'73706563',0,0,0,0,0,0,2,1,0,0,NULL,NULL,NULL,'token','43 1 boot',1004,2004,NULL,NULL,NULL,'77',2504,'node3');
CREATE TABLE checkpoint (
  job INTEGER PRIMARY KEY REFERENCES job ON DELETE CASCADE,
  digest TEXT NOT NULL REFERENCES blob,
  size INTEGER NOT NULL,
  attempt INTEGER NOT NULL,
  level INTEGER NOT NULL,
  iteration INTEGER NOT NULL
);
INSERT INTO checkpoint VALUES(8,'sha256:stand',30,1,2,17);
CREATE TABLE lost_attempt (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  attempt INTEGER NOT NULL,
  reason TEXT NOT NULL,
  batch_id TEXT NOT NULL,
  host TEXT NOT NULL,
  ended INTEGER NOT NULL,
  PRIMARY KEY (job, attempt)
) WITHOUT ROWID;
INSERT INTO lost_attempt VALUES(8,1,'STALLED','76','node2',2400);
DELETE FROM sqlite_sequence;
INSERT INTO sqlite_sequence VALUES('job',12);
CREATE INDEX input_by_digest ON input (digest);
CREATE INDEX artifact_by_digest ON artifact (digest);
CREATE INDEX job_by_state ON job (state, sequence);
CREATE INDEX job_by_submitter ON job (submitter, sequence);
CREATE INDEX queued_by_submitter ON job (submitter) WHERE state = 0;
CREATE INDEX label_by_value ON label (name, value, job);
CREATE INDEX checkpoint_by_digest ON checkpoint (digest);
CREATE INDEX blob_by_unreferenced ON blob (unreferenced_since) WHERE unreferenced_since IS NOT NULL;
CREATE INDEX job_by_end ON job (ended) WHERE ended IS NOT NULL;
CREATE INDEX blob_by_owner ON blob (owner, size) WHERE owner <> '';
PRAGMA application_id=1936487541;
PRAGMA user_version=6;
COMMIT;
)sql";

}  // namespace saltus::testing_support
