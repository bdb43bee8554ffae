# find_package(dunkelfeld) gives the targets dunkelfeld::dunkelfeld (shared library) and dunkelfeld::static.

get_filename_component(_dunkelfeld_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
find_path(dunkelfeld_INCLUDE_DIR dunkelfeld.h PATHS "${_dunkelfeld_prefix}/include" NO_DEFAULT_PATH)
find_library(dunkelfeld_LIBRARY dunkelfeld PATHS "${_dunkelfeld_prefix}" PATH_SUFFIXES lib lib64
             "lib/${CMAKE_LIBRARY_ARCHITECTURE}" NO_DEFAULT_PATH)
find_library(dunkelfeld_STATIC_LIBRARY "${CMAKE_STATIC_LIBRARY_PREFIX}dunkelfeld${CMAKE_STATIC_LIBRARY_SUFFIX}"
             PATHS "${_dunkelfeld_prefix}" PATH_SUFFIXES lib lib64 "lib/${CMAKE_LIBRARY_ARCHITECTURE}" NO_DEFAULT_PATH)
mark_as_advanced(dunkelfeld_INCLUDE_DIR dunkelfeld_LIBRARY dunkelfeld_STATIC_LIBRARY)

if(NOT dunkelfeld_INCLUDE_DIR OR NOT dunkelfeld_LIBRARY)
  set(dunkelfeld_FOUND FALSE)
  set(dunkelfeld_NOT_FOUND_MESSAGE "dunkelfeld.h or its library is not in ${_dunkelfeld_prefix}")
  return()
endif()

if(NOT TARGET dunkelfeld::dunkelfeld)
  add_library(dunkelfeld::dunkelfeld UNKNOWN IMPORTED)
  set_target_properties(dunkelfeld::dunkelfeld PROPERTIES
    IMPORTED_LOCATION "${dunkelfeld_LIBRARY}"
    INTERFACE_INCLUDE_DIRECTORIES "${dunkelfeld_INCLUDE_DIR}")
endif()

if(dunkelfeld_STATIC_LIBRARY AND NOT TARGET dunkelfeld::static)
  find_package(Threads REQUIRED)
  add_library(dunkelfeld::static UNKNOWN IMPORTED)
  set_target_properties(dunkelfeld::static PROPERTIES
    IMPORTED_LOCATION "${dunkelfeld_STATIC_LIBRARY}"
    INTERFACE_INCLUDE_DIRECTORIES "${dunkelfeld_INCLUDE_DIR}"
    INTERFACE_LINK_LIBRARIES "Threads::Threads;${CMAKE_DL_LIBS};m")
endif()
