# Fails when a folder includes a layer that it must not know.
# Usage: cmake -DROOT=<source folder> -P include_rules.cmake
#
# allow(<folder> EXCEPT <folders> ONLY <regexes>): every include must match one of the regexes.
# forbid(<folder> EXCEPT <folders> INCLUDES <regexes>): no include may match one of them.
# A regex is matched from the opening < or " on; files named are headers and sources below the folder.

set(violations "")

function(includes_of folder exempt result)
  file(GLOB_RECURSE files RELATIVE "${ROOT}" "${ROOT}/${folder}/*.h" "${ROOT}/${folder}/*.cpp")
  set(found "")
  foreach(file IN LISTS files)
    set(skip FALSE)
    foreach(folder_exempt IN LISTS exempt)
      if(file MATCHES "^${folder_exempt}/")
        set(skip TRUE)
      endif()
    endforeach()
    if(NOT skip)
      file(STRINGS "${ROOT}/${file}" lines REGEX "^[ \t]*#[ \t]*include[ \t]*[<\"]")
      foreach(line IN LISTS lines)
        string(REGEX REPLACE "^[ \t]*#[ \t]*include[ \t]*([<\"][^>\"]*[>\"]).*" "\\1" include "${line}")
        list(APPEND found "${file}: ${include}")
      endforeach()
    endif()
  endforeach()
  set(${result} "${found}" PARENT_SCOPE)
endfunction()

function(is_match entry regexes result)
  string(REGEX REPLACE "^[^<\"]+" "" include "${entry}")
  set(${result} FALSE PARENT_SCOPE)
  foreach(regex IN LISTS regexes)
    if(include MATCHES "^${regex}")
      set(${result} TRUE PARENT_SCOPE)
    endif()
  endforeach()
endfunction()

function(allow folder)
  cmake_parse_arguments(PARSE_ARGV 1 rule "" "" "EXCEPT;ONLY")
  includes_of(${folder} "${rule_EXCEPT}" entries)
  foreach(entry IN LISTS entries)
    is_match("${entry}" "${rule_ONLY}" matches)
    if(NOT matches)
      list(APPEND violations "${entry}")
    endif()
  endforeach()
  set(violations "${violations}" PARENT_SCOPE)
endfunction()

function(forbid folder)
  cmake_parse_arguments(PARSE_ARGV 1 rule "" "" "EXCEPT;INCLUDES")
  includes_of(${folder} "${rule_EXCEPT}" entries)
  foreach(entry IN LISTS entries)
    is_match("${entry}" "${rule_INCLUDES}" matches)
    if(matches)
      list(APPEND violations "${entry}")
    endif()
  endforeach()
  set(violations "${violations}" PARENT_SCOPE)
endfunction()

set(standard "<[a-z0-9_]+>")
set(numerics "${standard}" "<Eigen/" "<omp[.]h>")
set(images "<itk" "<vtk")
set(rpc "<grpc" "<google/" "[<\"].*[.]pb[.]h")
set(service "<spdlog" "<sqlite3" "<nlohmann" "<CLI/")

# The numerics see Eigen, OpenMP and the standard library; foreign image types stop in core/image_io.
allow(core EXCEPT core/image_io core/drawing core/support ONLY ${numerics} "\"core/")
forbid(core INCLUDES ${rpc} ${service} "\"(server|client)/")
forbid(core EXCEPT core/image_io INCLUDES "\"core/image_io/")
forbid(core EXCEPT core/drawing INCLUDES "\"core/drawing/")
# Reports and studies are drawn with the same pen, which sees libpng.
allow(core/drawing ONLY ${numerics} "<png[.]h>" "<zlib[.]h>" "\"core/(support|grid|evaluation|drawing)/")

# Inside core: grid, kernels -> momenta -> flow; grid -> similarity; optimisation knows none; registration joins.
allow(core/support ONLY ${numerics} "<sched[.]h>" "<malloc[.]h>" "\"core/support/")
allow(core/grid ONLY ${numerics} "\"core/(support|grid)/")
allow(core/kernels ONLY ${numerics} "\"core/(support|grid|kernels)/")
allow(core/momenta ONLY ${numerics} "\"core/(support|grid|kernels|momenta)/")
allow(core/flow ONLY ${numerics} "\"core/(support|grid|kernels|momenta|flow)/")
allow(core/similarity ONLY ${numerics} "\"core/(support|grid|similarity)/")
allow(core/optimisation ONLY ${numerics} "\"core/(support|optimisation)/")
forbid(core/registration INCLUDES "\"core/(phantom|evaluation|image_io)/")

# The queue and its state machine are the standard library's alone.
allow(server/jobs ONLY ${standard} "\"server/jobs/" "\"core/support/errors[.]h\"")
forbid(server/store INCLUDES ${images} "<grpc" "\"server/(rpc|worker)/")
allow(server/rpc ONLY ${standard} ${rpc} "<spdlog" "<openssl/" "<sys/" "\"server/(rpc|jobs)/" "\"core/registration/options[.]h\""
      "\"proto/crc32c[.]h\"" "\"core/support/errors[.]h\"")
forbid(server/observe INCLUDES ${images} "<sqlite3" "<grpcpp" "\"server/(store|launch|config|worker)/")
forbid(server EXCEPT server/observe INCLUDES "<prometheus")
# A worker is a client of the daemon: it moves bytes by the client library, and that is all it takes from there.
forbid(server/worker INCLUDES ${images} "<sqlite3" "\"server/(rpc|store)/" "\"client/cli/")
forbid(server/worker/report INCLUDES ${rpc} "<spdlog" "\"core/image_io/" "\"server/jobs/")
forbid(server INCLUDES ${images})
# Files from strangers are decoded in the worker, which dies alone.
forbid(server EXCEPT server/worker INCLUDES "\"core/image_io/")
forbid(server EXCEPT server/worker INCLUDES "\"client/")

# Clients speak the protocol; the library carries no numerics, the command line nothing of the server.
forbid(client/lib INCLUDES ${images} "\"(core|server)/" "\"client/cli/")
forbid(client/cli INCLUDES ${images} "<sqlite3" "\"server/")

if(violations)
  list(REMOVE_DUPLICATES violations)
  list(JOIN violations "\n  " text)
  message(FATAL_ERROR "Forbidden includes:\n  ${text}")
endif()
