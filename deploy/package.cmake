# The Debian packages saltus-server, saltus-worker, saltus-client and libsaltus-dev: deploy/package, or cpack in a build
# folder. Packages for other machines need -DSALTUS_ARCH=x86-64-v3, which deploy/package sets.
set(SALTUS_MAINTAINER "The saltus developers <saltus@localhost.localdomain>" CACHE STRING "Whom the packages name")

# What belongs to a system and to no prefix: left out by cmake --install, absolute in the packages.
install(FILES deploy/systemd/saltusd.service DESTINATION /lib/systemd/system COMPONENT server EXCLUDE_FROM_ALL)
install(FILES deploy/systemd/saltusd.conf DESTINATION /etc/saltus COMPONENT server EXCLUDE_FROM_ALL)
install(FILES deploy/systemd/roles DESTINATION /etc/saltus COMPONENT server EXCLUDE_FROM_ALL
  PERMISSIONS OWNER_READ OWNER_WRITE GROUP_READ)
install(DIRECTORY DESTINATION /etc/saltus/tls COMPONENT server EXCLUDE_FROM_ALL
  DIRECTORY_PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE)
install(FILES deploy/README.md DESTINATION /usr/share/doc/saltus-server COMPONENT server EXCLUDE_FROM_ALL)
install(DIRECTORY deploy/prometheus deploy/proxy DESTINATION /usr/share/doc/saltus-server/examples
  COMPONENT server EXCLUDE_FROM_ALL)

find_program(GZIP gzip REQUIRED)
set(changelog ${PROJECT_BINARY_DIR}/share/changelog.Debian.gz)
add_custom_command(OUTPUT ${changelog} DEPENDS ${PROJECT_SOURCE_DIR}/deploy/debian/changelog VERBATIM
  COMMAND ${GZIP} -9nc ${PROJECT_SOURCE_DIR}/deploy/debian/changelog > ${changelog})
add_custom_target(saltus_changelog ALL DEPENDS ${changelog})

# An older processor is told at the installation, and not by an illegal instruction in the night.
set(SALTUS_CPU_FEATURES "")
if(SALTUS_ARCH MATCHES "^(native|x86-64-v3)$" AND CMAKE_SYSTEM_PROCESSOR STREQUAL "x86_64")
  set(SALTUS_CPU_FEATURES "avx2 fma bmi2 f16c movbe")
endif()
set(scripts ${PROJECT_SOURCE_DIR}/deploy/debian)
configure_file(deploy/debian/preinst.in ${PROJECT_BINARY_DIR}/share/preinst @ONLY
  FILE_PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME saltus)
set(CPACK_PACKAGE_VENDOR saltus)
set(CPACK_PACKAGE_CONTACT "${SALTUS_MAINTAINER}")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "registration of medical images whose motion slides")
set(CPACK_SET_DESTDIR ON)
set(CPACK_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_PRE_BUILD_SCRIPTS ${PROJECT_SOURCE_DIR}/deploy/debian/compress_manuals.cmake)
set(CPACK_COMPONENTS_ALL server worker client development)
set(CPACK_COMPONENTS_GROUPING IGNORE)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
if(SALTUS_ARCH STREQUAL "native")
  # Nobody takes it for a package that runs anywhere.
  set(CPACK_DEBIAN_PACKAGE_RELEASE 1~native)
endif()
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_PACKAGE_MAINTAINER "${SALTUS_MAINTAINER}")

set(same "(= ${PROJECT_VERSION}-${CPACK_DEBIAN_PACKAGE_RELEASE})")
function(saltus_package component name section)
  cmake_parse_arguments(PARSE_ARGV 3 arg "" "DESCRIPTION;DEPENDS;RECOMMENDS;SUGGESTS" "SCRIPTS")
  string(TOUPPER ${component} id)
  set(CPACK_DEBIAN_${id}_PACKAGE_NAME ${name} PARENT_SCOPE)
  set(CPACK_DEBIAN_${id}_PACKAGE_SECTION ${section} PARENT_SCOPE)
  set(CPACK_DEBIAN_${id}_PACKAGE_DEPENDS "${arg_DEPENDS}" PARENT_SCOPE)
  set(CPACK_DEBIAN_${id}_PACKAGE_RECOMMENDS "${arg_RECOMMENDS}" PARENT_SCOPE)
  set(CPACK_DEBIAN_${id}_PACKAGE_SUGGESTS "${arg_SUGGESTS}" PARENT_SCOPE)
  set(CPACK_DEBIAN_${id}_PACKAGE_CONTROL_EXTRA "${arg_SCRIPTS}" PARENT_SCOPE)
  set(CPACK_DEBIAN_${id}_DESCRIPTION "saltus registers images of lungs along the chest wall, of the liver along
the abdomen, and others. ${arg_DESCRIPTION}" PARENT_SCOPE)
  install(FILES ${changelog} ${PROJECT_SOURCE_DIR}/deploy/debian/copyright DESTINATION /usr/share/doc/${name}
    COMPONENT ${component} EXCLUDE_FROM_ALL)
endfunction()

set(same "(= ${PROJECT_VERSION}-${CPACK_DEBIAN_PACKAGE_RELEASE})")
set(service ${scripts}/server/postinst ${scripts}/server/prerm ${scripts}/server/postrm ${scripts}/server/conffiles)
saltus_package(server saltus-server net
  DESCRIPTION "This is the daemon: it keeps a queue of
jobs and hands them to workers."
  DEPENDS "saltus-worker ${same}, adduser, init-system-helpers (>= 1.52), openssl, rsync, sqlite3"
  SUGGESTS "nginx, prometheus"
  SCRIPTS ${service})
saltus_package(worker saltus-worker science
  DESCRIPTION "This is the worker, which the daemon
or a batch system starts for each job."
  SCRIPTS ${PROJECT_BINARY_DIR}/share/preinst)
saltus_package(client saltus-client science
  DESCRIPTION "This is the command line. It uses a
daemon of this machine or another, or starts a private one, for which it needs
saltus-server."
  RECOMMENDS "saltus-server ${same}"
  SCRIPTS ${PROJECT_BINARY_DIR}/share/preinst)
saltus_package(development libsaltus-dev libdevel
  DESCRIPTION "These are three static libraries for
C++ with their headers, for find_package(saltus): the numerics, image
files, and a client of the daemon; and the protocol for other languages."
  DEPENDS "libeigen3-dev, libgrpc++-dev, libprotobuf-dev, libssl-dev"
  RECOMMENDS "libinsighttoolkit5-dev, zlib1g-dev, libisal-dev"
  SUGGESTS "cmake, g++"
  SCRIPTS ${PROJECT_BINARY_DIR}/share/preinst)
include(CPack)
