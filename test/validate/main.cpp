#include <iostream>

#include "scene.h"

int main(int count, char** values) {
  return calligraphy_brush::validate::runValidate({values + 1, values + count}, std::cout, std::cerr);
}
