/* Walks with the policy file that is given, by nothing but the library beside it. */
#include <stddef.h>
#include <stdio.h>

int bare_walk(const unsigned char *bytes, size_t len);

static unsigned char file[1 << 20];

int main(int count, char **arguments)
{
    FILE *stream = count == 2 ? fopen(arguments[1], "rb") : NULL;
    if (!stream)
        return 1;
    size_t len = fread(file, 1, sizeof file, stream);
    printf("%d\n", bare_walk(file, len));
    return 0;
}
