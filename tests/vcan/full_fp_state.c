/*
 * Preloaded into user-mode-linux by tests/vcan/run: lets it run on processors with AMX.
 *
 * UML up to 6.11 keeps 2696 bytes of a process's extended state and writes them back with PTRACE_SETREGSET. A host whose
 * processor has more (AMX: 11 kB) refuses a buffer that is not whole, and UML kills init on its first return to user
 * space. Here the buffer is completed: what follows is the state of units that were never used, all zero, as the
 * XSTATE_BV field within the first 2696 bytes says. Where UML's buffer is whole, nothing is changed.
 */
#include <elf.h>
#include <errno.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

static char buffer[65536]; /* one thread of UML calls ptrace */
static size_t whole;       /* size of the host's extended state; 0: not asked yet */

static long set_extended_state(pid_t pid, void *address, struct iovec *given)
{
    if (!whole) {
        struct iovec all = {buffer, sizeof buffer};
        if (syscall(SYS_ptrace, PTRACE_GETREGSET, pid, address, &all))
            return -1;
        whole = all.iov_len;
        memset(buffer, 0, sizeof buffer);
    }
    if (given->iov_len >= whole)
        return syscall(SYS_ptrace, PTRACE_SETREGSET, pid, address, given);
    memcpy(buffer, given->iov_base, given->iov_len);
    struct iovec all = {buffer, whole};
    return syscall(SYS_ptrace, PTRACE_SETREGSET, pid, address, &all);
}

long ptrace(enum __ptrace_request request, ...)
{
    va_list rest;
    va_start(rest, request);
    pid_t pid = va_arg(rest, pid_t);
    void *address = va_arg(rest, void *);
    void *data = va_arg(rest, void *);
    va_end(rest);

    if (request == PTRACE_SETREGSET && (unsigned long)address == NT_X86_XSTATE)
        return set_extended_state(pid, address, data);
    if (request == PTRACE_PEEKTEXT || request == PTRACE_PEEKDATA || request == PTRACE_PEEKUSER) {
        long word = 0; /* the system call stores the word, the library function returns it */
        if (syscall(SYS_ptrace, request, pid, address, &word) < 0)
            return -1;
        errno = 0;
        return word;
    }
    return syscall(SYS_ptrace, request, pid, address, data);
}
