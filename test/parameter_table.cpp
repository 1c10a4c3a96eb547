#include "parameter_table.h"

#include <cstring>
#include <iostream>

// Prints the table between the README's markers; with --tablet that of the tablet driver.
int main(int argc, char** argv) {
  const bool is_tablet = argc > 1 && std::strcmp(argv[1], "--tablet") == 0;
  std::cout << (is_tablet ? calligraphy_brush::makeTabletParameterTable()
                          : calligraphy_brush::makeParameterTable());
}
