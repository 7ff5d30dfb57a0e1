# Read by CMake right after project() when CMAKE_PROJECT_INCLUDE names this file. It lets the stock
# CMakeLists.txt build against the ROS packages that pip installs, for the wheel and for colcon
# alike. On a ROS installation from apt it is not needed, and nothing refers to it.

if(SKBUILD)
  # pip builds in an isolated environment of its own. The prefix that ament_package is imported
  # from is where that environment keeps its share/ folders, with the packages' CMake files.
  find_package(Python3 REQUIRED COMPONENTS Interpreter)
  execute_process(
    COMMAND "${Python3_EXECUTABLE}" -c
      "import ament_package, pathlib; print(pathlib.Path(ament_package.__file__).parents[4])"
    OUTPUT_VARIABLE _usmap_prefix
    OUTPUT_STRIP_TRAILING_WHITESPACE
    COMMAND_ERROR_IS_FATAL ANY
  )
  list(PREPEND CMAKE_PREFIX_PATH "${_usmap_prefix}")
  set(ENV{AMENT_PREFIX_PATH} "${_usmap_prefix}")

  # Everything is installed below the wheel's data/ folder. The Python modules are not data: this
  # path leads them next door, to what pip unpacks into site-packages.
  set(PYTHON_INSTALL_DIR "../platlib" CACHE PATH "Where the Python modules go" FORCE)
endif()

# The ROS wheels' CMake files name include directories of the machine that built them. Here they
# do not exist, and CMake refuses a target with an include directory that does not exist.
function(usmap_drop_foreign_include_dirs)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(dirs "${target}" INTERFACE_INCLUDE_DIRECTORIES)
    if(dirs)
      list(FILTER dirs EXCLUDE REGEX "^/opt/python/")
      set_target_properties("${target}" PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${dirs}")
    endif()
  endforeach()
endfunction()
cmake_language(DEFER CALL usmap_drop_foreign_include_dirs)
