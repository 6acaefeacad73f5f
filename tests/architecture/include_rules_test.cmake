# Plants one forbidden include per rule in an empty tree and expects include_rules.cmake to name each of them, and
# nothing that is allowed.
# Usage: cmake -DRULES=<include_rules.cmake> -DFOLDER=<scratch folder> -P include_rules_test.cmake

set(forbidden
  "core/flow|<itkImage.h>"
  "core/registration|<vtkImageData.h>"
  "core/grid|<grpcpp/grpcpp.h>"
  "core/image_io|<google/protobuf/message.h>"
  "core/image_io|\"saltus/v1/registration.pb.h\""
  "core/registration|<spdlog/spdlog.h>"
  "core/registration|\"core/image_io/read_image.h\""
  "core/evaluation|<nlohmann/json.hpp>"
  "core/phantom|\"server/jobs/job.h\""
  "core/grid|\"core/momenta/packing.h\""
  "core/kernels|\"core/flow/deformation.h\""
  "core/similarity|\"core/momenta/packing.h\""
  "core/optimisation|\"core/grid/volume.h\""
  "core/momenta|\"core/flow/deformation.h\""
  "core/registration|\"core/phantom/phantom.h\""
  "server/jobs|<sqlite3.h>"
  "server/jobs|<grpcpp/grpcpp.h>"
  "server/jobs|\"server/store/blob_store.h\""
  "server/store|\"server/rpc/convert.h\""
  "server/rpc|\"server/store/blob_store.h\""
  "server/rpc|\"core/registration/register_images.h\""
  "server/rpc|<itkImage.h>"
  "server/rpc|\"client/lib/channel.h\""
  "server/worker|\"server/rpc/convert.h\""
  "server/worker|\"client/cli/connection.h\""
  "server/worker/report|<grpcpp/grpcpp.h>"
  "server|<itkImage.h>"
  "server|\"core/image_io/read_image.h\""
  "server/store|\"core/image_io/read_image.h\""
  "client/lib|\"core/grid/volume.h\""
  "client/lib|\"server/jobs/job.h\""
  "client/cli|\"server/rpc/convert.h\"")
set(allowed
  "core/flow|<vector>"
  "core/flow|<Eigen/Core>"
  "core/flow|\"core/momenta/packing.h\""
  "core/image_io|<itkImage.h>"
  "core/registration|\"core/similarity/similarity.h\""
  "server/jobs|<chrono>"
  "server/rpc|\"core/registration/options.h\""
  "server/rpc|<grpcpp/grpcpp.h>"
  "server/worker|\"core/image_io/read_image.h\""
  "server/worker|\"client/lib/blob_transfer.h\""
  "client/cli|\"core/image_io/read_image.h\""
  "client/cli|\"client/lib/registration_client.h\"")

function(plant cases kind)
  set(number 0)
  foreach(case IN LISTS cases)
    string(REPLACE "|" ";" parts "${case}")
    list(GET parts 0 folder)
    list(GET parts 1 include)
    math(EXPR number "${number} + 1")
    file(WRITE "${FOLDER}/${folder}/${kind}_${number}.cpp" "#include ${include}\n")
  endforeach()
endfunction()

function(run_rules output)
  execute_process(COMMAND ${CMAKE_COMMAND} -DROOT=${FOLDER} -P ${RULES}
                  RESULT_VARIABLE code OUTPUT_VARIABLE text ERROR_VARIABLE text)
  set(code ${code} PARENT_SCOPE)
  set(${output} "${text}" PARENT_SCOPE)
endfunction()

file(REMOVE_RECURSE "${FOLDER}")
plant("${allowed}" allowed)
run_rules(text)
if(NOT code EQUAL 0)
  message(FATAL_ERROR "A tree with allowed includes only was refused:\n${text}")
endif()

plant("${forbidden}" forbidden)
run_rules(text)
if(code EQUAL 0)
  message(FATAL_ERROR "A tree with forbidden includes passed.")
endif()
set(number 0)
foreach(case IN LISTS forbidden)
  math(EXPR number "${number} + 1")
  if(NOT text MATCHES "/forbidden_${number}[.]cpp: ")
    message(SEND_ERROR "Not found: ${case}")
  endif()
endforeach()
if(text MATCHES "/allowed_")
  message(SEND_ERROR "An allowed include was named:\n${text}")
endif()
