/* For user-mode Linux on processors whose register state is larger than the kernel in it expects (AMX: 11 KiB): that kernel
 * hands the host's kernel the first part of the state, which is refused. Preloaded, this completes it with the rest, which is
 * what it was in the first process: no guest uses registers that its kernel does not know of. Where the state is small enough,
 * nothing changes. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>

enum { LARGEST = 64 * 1024 };

long ptrace(enum __ptrace_request request, ...)
{
    static long (*next)(enum __ptrace_request, ...);
    static unsigned char whole[LARGEST] __attribute__((aligned(64)));
    static size_t size;

    va_list list;
    va_start(list, request);
    pid_t pid = va_arg(list, pid_t);
    void *address = va_arg(list, void *);
    void *data = va_arg(list, void *);
    va_end(list);
    if (!next)
        next = (long (*)(enum __ptrace_request, ...))dlsym(RTLD_NEXT, "ptrace");
    if (request == PTRACE_SETREGSET && (unsigned long)address == NT_X86_XSTATE) {
        const struct iovec *part = data;
        struct iovec all = { whole, sizeof whole };
        if (size == 0 && next(PTRACE_GETREGSET, pid, address, &all) == 0)
            size = all.iov_len;
        if (part->iov_len < size) {
            memcpy(whole, part->iov_base, part->iov_len);
            all.iov_len = size;
            return next(PTRACE_SETREGSET, pid, address, &all);
        }
    }
    return next(request, pid, address, data);
}
