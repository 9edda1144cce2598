/*
 * Lets a user-mode Linux run on processors with more registers than it was built for.
 *
 * A user-mode Linux keeps its processes' extended registers in an area of fixed size (6.1: 2 696 bytes, enough up to AVX-512 and
 * protection keys) and writes them back with ptrace(PTRACE_SETREGSET, NT_X86_XSTATE). The host takes the whole area or
 * nothing: where the processor also has AMX (11 008 bytes), it answers EFAULT, and the user-mode Linux kills its first process:
 * "ptrace set fp regs failed, errno = 14". Reading a part is allowed, so it never learns that its area is too short.
 *
 * This library, preloaded, completes such a write: the registers it was given, the rest empty, and the components that begin
 * behind the given part marked "in their initial state". No state is lost by that: a process must ask its kernel for AMX
 * before it may use it, and a user-mode Linux refuses.
 *
 * It is built by tcc with neither headers nor libraries; the few names it needs are declared here. ptrace(2) and the
 * "XSAVE area" chapter of the processor manuals are the sources. A user-mode Linux has one thread that calls ptrace.
 */

enum {
    PTRACE_GETREGSET = 0x4204,
    PTRACE_SETREGSET = 0x4205,
    NT_X86_XSTATE = 0x202,
    XSTATE_BV = 512 /* offset of the bit map that says which components are not in their initial state */
};

struct span {
    void *base;
    unsigned long length;
};

typedef long ptrace_function(int request, long pid, void *address, void *data);

extern void *dlsym(void *library, const char *name);
static void *const NEXT_LIBRARY = (void *)-1L; /* RTLD_NEXT */

static unsigned char whole[64 * 1024]; /* zero behind what is given, always */
static unsigned long whole_length;     /* what the host wants; 0 until asked */

static void forget_amx(unsigned char *area)
{
    /* Components 17 and 18, the AMX tiles, are the first two bits of interest in the map's third byte. */
    area[XSTATE_BV + 2] &= (unsigned char)~0x06;
}

static long ask_whole_length(ptrace_function *next, long pid)
{
    struct span all = {whole, sizeof whole};
    unsigned long i;
    if (next(PTRACE_GETREGSET, pid, (void *)NT_X86_XSTATE, &all) < 0)
        return -1;
    for (i = 0; i < sizeof whole; i++)
        whole[i] = 0;
    whole_length = all.length;
    return 0;
}

long ptrace(int request, long pid, void *address, void *data)
{
    static ptrace_function *next;
    struct span *given = data, all;
    unsigned long i;

    if (!next)
        next = (ptrace_function *)dlsym(NEXT_LIBRARY, "ptrace");
    if (request != PTRACE_SETREGSET || address != (void *)NT_X86_XSTATE)
        return next(request, pid, address, data);
    if (!whole_length && ask_whole_length(next, pid) < 0)
        return -1;
    if (given->length >= whole_length)
        return next(request, pid, address, data);
    for (i = 0; i < given->length; i++)
        whole[i] = ((unsigned char *)given->base)[i];
    forget_amx(whole);
    all.base = whole;
    all.length = whole_length;
    return next(request, pid, address, &all);
}
