/* ptrace() for User-Mode Linux on CPUs whose extended registers outgrow its buffer.
 *
 * Debian's kernel 6.1 keeps a process's floating point and vector registers (the XSAVE area) in 2696 bytes.
 * With AMX the area has 11 KiB; Linux then refuses to set it from a part ("ptrace set fp regs failed,
 * errno = 14") and the guest panics. So all of it is always moved here: read whole and handed on in part,
 * written whole, with zeros behind what the guest knows of. Its programs therefore can't use AMX. On other
 * CPUs nothing is changed. Loaded into linux.uml by LD_PRELOAD.
 */
#define _GNU_SOURCE
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

enum {
    XSTATE = 0x202,     /* NT_X86_XSTATE, the register set's number */
    XSTATE_BV = 512,    /* bytes into the area: which parts of it are not in their initial state */
    AMX_BITS = 6,       /* of its third byte: tile configuration and tile data */
};

static char whole[1 << 16] __attribute__((aligned(64)));
static size_t whole_size;

static long get_xstate(long pid, struct iovec *part)
{
    struct iovec all = {whole, sizeof whole};
    long result = syscall(SYS_ptrace, PTRACE_GETREGSET, pid, XSTATE, &all);
    if (result < 0)
        return result;
    whole_size = all.iov_len;
    if (part->iov_len > whole_size)
        part->iov_len = whole_size;
    memcpy(part->iov_base, whole, part->iov_len);
    memset(whole + part->iov_len, 0, whole_size - part->iov_len);
    return 0;
}

static long set_xstate(long pid, const struct iovec *part)
{
    struct iovec all = {whole, whole_size};
    memcpy(whole, part->iov_base, part->iov_len);
    whole[XSTATE_BV + 2] &= ~AMX_BITS;
    return syscall(SYS_ptrace, PTRACE_SETREGSET, pid, XSTATE, &all);
}

long ptrace(enum __ptrace_request request, ...)
{
    va_list arguments;
    va_start(arguments, request);
    long pid = va_arg(arguments, int), address = va_arg(arguments, long), data = va_arg(arguments, long);
    va_end(arguments);

    if (address == XSTATE && request == PTRACE_GETREGSET)
        return get_xstate(pid, (struct iovec *)data);
    if (address == XSTATE && request == PTRACE_SETREGSET && whole_size > ((struct iovec *)data)->iov_len)
        return set_xstate(pid, (struct iovec *)data);
    if (request == PTRACE_PEEKTEXT || request == PTRACE_PEEKDATA || request == PTRACE_PEEKUSER) {
        long word, result = syscall(SYS_ptrace, request, pid, address, &word);
        return result < 0 ? result : word;
    }
    return syscall(SYS_ptrace, request, pid, address, data);
}
