/* The raster of a terrain, taken whole into the library. */

#define INCLUDE(name, file)                     \
    __asm__(".section .rodata\n"                \
            ".balign 16\n"                      \
            ".global " #name "\n"               \
            ".hidden " #name "\n"               \
            #name ":\n"                         \
            ".incbin \"" file "\"\n"            \
            ".text\n")

INCLUDE(aoro_nodes, "nodes.bin");
INCLUDE(aoro_cover, "cover.bin");
INCLUDE(aoro_ceilings, "ceilings.bin");
