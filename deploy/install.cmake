# cmake --install: the programs, the manual page, shell completion, and three libraries for find_package(saltus):
# saltus::core (the numerics; needs Eigen and OpenMP), saltus::image_io (image files; needs ITK) and saltus::client (the
# service; needs gRPC).
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

set(headers ${CMAKE_INSTALL_INCLUDEDIR}/saltus)
set(package ${CMAKE_INSTALL_LIBDIR}/cmake/saltus)

set_target_properties(saltus_core PROPERTIES EXPORT_NAME core)
set_target_properties(saltus_image_io PROPERTIES EXPORT_NAME image_io)
set_target_properties(saltus_client PROPERTIES EXPORT_NAME client)
set_target_properties(saltus_crc32c PROPERTIES EXPORT_NAME crc32c)
set_target_properties(saltus_proto PROPERTIES EXPORT_NAME proto)
# The components are those of the packages, see package.cmake.
install(TARGETS saltus COMPONENT client)
install(TARGETS saltusd COMPONENT server)
install(TARGETS saltus-worker COMPONENT worker)
install(TARGETS saltus_core project_options EXPORT saltus-core COMPONENT development INCLUDES DESTINATION ${headers})
install(TARGETS saltus_image_io EXPORT saltus-image_io COMPONENT development INCLUDES DESTINATION ${headers})
install(TARGETS saltus_client saltus_crc32c saltus_proto EXPORT saltus-client COMPONENT development INCLUDES DESTINATION ${headers})
install(EXPORT saltus-core NAMESPACE saltus:: DESTINATION ${package} COMPONENT development)
install(EXPORT saltus-image_io NAMESPACE saltus:: DESTINATION ${package} COMPONENT development)
install(EXPORT saltus-client NAMESPACE saltus:: DESTINATION ${package} COMPONENT development)

# Sources include by their place in the repository, and so do those who use the libraries.
install(DIRECTORY core DESTINATION ${headers} COMPONENT development FILES_MATCHING PATTERN "*.h"
  PATTERN "drawing" EXCLUDE)
install(DIRECTORY client/lib DESTINATION ${headers}/client COMPONENT development FILES_MATCHING PATTERN "*.h")
install(DIRECTORY ${PROJECT_BINARY_DIR}/proto/saltus DESTINATION ${headers} COMPONENT development
  FILES_MATCHING PATTERN "*.pb.h")
install(DIRECTORY proto/saltus DESTINATION ${CMAKE_INSTALL_DATADIR}/saltus/proto COMPONENT development
  FILES_MATCHING PATTERN "*.proto")

get_target_property(saltus_itk_modules saltus_image_io ITK_MODULES)
list(JOIN saltus_itk_modules " " saltus_itk_modules)
configure_package_config_file(deploy/saltus-config.cmake.in ${PROJECT_BINARY_DIR}/saltus-config.cmake
  INSTALL_DESTINATION ${package})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/saltus-config-version.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/saltus-config.cmake ${PROJECT_BINARY_DIR}/saltus-config-version.cmake
  DESTINATION ${package} COMPONENT development)

# What saltus says about itself.
set(written ${PROJECT_BINARY_DIR}/share)
file(MAKE_DIRECTORY ${written})
add_custom_command(OUTPUT ${written}/saltus.1 ${written}/saltus ${written}/_saltus ${written}/saltus.fish VERBATIM
  DEPENDS saltus
  COMMAND saltus man > ${written}/saltus.1
  COMMAND saltus completion bash > ${written}/saltus
  COMMAND saltus completion zsh > ${written}/_saltus
  COMMAND saltus completion fish > ${written}/saltus.fish)
add_custom_target(saltus_manual ALL DEPENDS ${written}/saltus.1)
install(FILES ${written}/saltus.1 DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 COMPONENT client)
install(FILES ${written}/saltus DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions COMPONENT client)
install(FILES ${written}/_saltus DESTINATION ${CMAKE_INSTALL_DATADIR}/zsh/site-functions COMPONENT client)
install(FILES ${written}/saltus.fish DESTINATION ${CMAKE_INSTALL_DATADIR}/fish/vendor_completions.d COMPONENT client)
install(FILES deploy/manual/saltusd.8 deploy/manual/saltus-backup.8 deploy/manual/saltus-certificates.8
  DESTINATION ${CMAKE_INSTALL_MANDIR}/man8 COMPONENT server)
install(FILES deploy/manual/saltus-worker.8 DESTINATION ${CMAKE_INSTALL_MANDIR}/man8 COMPONENT worker)
install(PROGRAMS deploy/operations/saltus-backup deploy/operations/saltus-certificates TYPE SBIN COMPONENT server)
