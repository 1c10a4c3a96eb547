#include "parameter_table.h"

#include <iostream>

// Prints the table between the README's markers.
int main() {
  std::cout << calligraphy_brush::makeParameterTable();
}
