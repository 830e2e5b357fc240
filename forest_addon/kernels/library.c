/* What the library says of itself. */
#include "kernels.h"

const char *kernels_sources(void)
{
    return KERNELS_SOURCES;
}
