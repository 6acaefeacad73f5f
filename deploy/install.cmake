# cmake --install: the programs, the manual page, shell completion, and two libraries for find_package(saltus):
# saltus::core (the numerics; needs Eigen and OpenMP) and saltus::client (the service; needs gRPC).
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

set(headers ${CMAKE_INSTALL_INCLUDEDIR}/saltus)
set(package ${CMAKE_INSTALL_LIBDIR}/cmake/saltus)

set_target_properties(saltus_core PROPERTIES EXPORT_NAME core)
set_target_properties(saltus_client PROPERTIES EXPORT_NAME client)
set_target_properties(saltus_proto PROPERTIES EXPORT_NAME proto)
install(TARGETS saltus saltusd saltus-worker)
install(TARGETS saltus_core project_options EXPORT saltus-core INCLUDES DESTINATION ${headers})
install(TARGETS saltus_client saltus_proto EXPORT saltus-client INCLUDES DESTINATION ${headers})
install(EXPORT saltus-core NAMESPACE saltus:: DESTINATION ${package})
install(EXPORT saltus-client NAMESPACE saltus:: DESTINATION ${package})

# Sources include by their place in the repository, and so do those who use the libraries.
install(DIRECTORY core DESTINATION ${headers} FILES_MATCHING PATTERN "*.h" PATTERN "image_io" EXCLUDE
  PATTERN "drawing" EXCLUDE)
install(DIRECTORY client/lib DESTINATION ${headers}/client FILES_MATCHING PATTERN "*.h")
install(DIRECTORY ${PROJECT_BINARY_DIR}/proto/saltus DESTINATION ${headers} FILES_MATCHING PATTERN "*.pb.h")
install(DIRECTORY proto/saltus DESTINATION ${CMAKE_INSTALL_DATADIR}/saltus/proto FILES_MATCHING PATTERN "*.proto")

configure_package_config_file(deploy/saltus-config.cmake.in ${PROJECT_BINARY_DIR}/saltus-config.cmake
  INSTALL_DESTINATION ${package})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/saltus-config-version.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/saltus-config.cmake ${PROJECT_BINARY_DIR}/saltus-config-version.cmake
  DESTINATION ${package})

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
install(FILES ${written}/saltus.1 DESTINATION ${CMAKE_INSTALL_MANDIR}/man1)
install(FILES ${written}/saltus DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions)
install(FILES ${written}/_saltus DESTINATION ${CMAKE_INSTALL_DATADIR}/zsh/site-functions)
install(FILES ${written}/saltus.fish DESTINATION ${CMAKE_INSTALL_DATADIR}/fish/vendor_completions.d)
