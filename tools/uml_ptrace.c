/*
 * Preloaded into User Mode Linux: lets it run on processors whose registers outgrew it.
 *
 * It keeps each process's extended registers in a buffer of fixed size. The host refuses to set registers from
 * less than its full size, which AMX enlarged to 11 kB ("ptrace set fp regs failed, errno = 14"). So a short
 * buffer is filled up with zeros here: what does not fit into it is a state that no process in there has.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/uio.h>

static long (*next)(int, ...);
static char registers[1 << 16];
static size_t full_size;

static long set_registers(pid_t pid, void *kind, const struct iovec *given)
{
	struct iovec full = {registers, sizeof(registers)};

	if (!full_size) {
		if (next(PTRACE_GETREGSET, pid, kind, &full) < 0)
			return -1;
		full_size = full.iov_len;
		memset(registers, 0, sizeof(registers));
	}
	if (given->iov_len >= full_size)
		return next(PTRACE_SETREGSET, pid, kind, given);
	memcpy(registers, given->iov_base, given->iov_len);
	full.iov_len = full_size;
	return next(PTRACE_SETREGSET, pid, kind, &full);
}

long ptrace(enum __ptrace_request request, ...)
{
	va_list arguments;

	va_start(arguments, request);
	pid_t pid = va_arg(arguments, pid_t);
	void *address = va_arg(arguments, void *);
	void *data = va_arg(arguments, void *);
	va_end(arguments);
	if (!next)
		next = (long (*)(int, ...))dlsym(RTLD_NEXT, "ptrace");
	if (request == PTRACE_SETREGSET && address == (void *)NT_X86_XSTATE)
		return set_registers(pid, address, data);
	return next(request, pid, address, data);
}
