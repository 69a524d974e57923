// Reads through a null pointer.
#include <stdio.h>

int main(void) {
  const int *volatile reading = NULL;
  puts("reads the first value");
  fflush(stdout);
  return *reading;
}
