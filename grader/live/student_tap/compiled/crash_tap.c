// Names the frames of a program in C or C++ that crashes.
//
// Loaded by LD_PRELOAD into a student's program. A signal of a crash makes it write the frames of the program's own files to
// the descriptor in GRADER_TAP_FD, innermost first, by addr2line in a process of its own: a line with the function, and one
// with file and line. The program then ends by the signal, as it would without this library.
#define _GNU_SOURCE
#include <elf.h>
#include <execinfo.h>
#include <fcntl.h>
#include <link.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <ucontext.h>
#include <unistd.h>

// Frames of a stack, and frames of one file that are named.
enum { MOST_FRAMES = 64, MOST_FILES = 4, MOST_PATH = 1024 };
// Time for all names, in s. A lock of the loader, held by another thread, can keep it from ending by itself.
enum { LONGEST_S = 3 };
enum { STACK_BYTES = 128 * 1024 };

static const char BEGIN[] = "Crash (innermost frame first):\n";
static const char END[] = "End of crash\n";
static const int SIGNALS[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};

static char program[MOST_PATH];
static char below[MOST_PATH];
static char stack[STACK_BYTES];
static int tap = -1;
static volatile sig_atomic_t crashed_by;

struct sought {
  ElfW(Addr) address;
  ElfW(Addr) base;
  char path[MOST_PATH];
};

static void tell(const char *text, size_t size)
{
  if (write(tap, text, size) < 0) {
    return;
  }
}

static int is_below(const char *path)
{
  return strncmp(path, below, strlen(below)) == 0;
}

// Notes the file that holds an address.
static int look(struct dl_phdr_info *file, size_t size, void *result)
{
  struct sought *sought = result;
  (void)size;
  for (int i = 0; i < file->dlpi_phnum; i++) {
    const ElfW(Phdr) *part = &file->dlpi_phdr[i];
    ElfW(Addr) begin = file->dlpi_addr + part->p_vaddr;
    if (part->p_type != PT_LOAD || sought->address < begin || sought->address >= begin + part->p_memsz) {
      continue;
    }
    sought->base = file->dlpi_addr;
    const char *path = file->dlpi_name[0] ? file->dlpi_name : program;
    strncpy(sought->path, path, MOST_PATH - 1);
    return 1;
  }
  return 0;
}

// Writes an address in hexadecimal digits; printf is not safe in a handler.
static void write_address(char *text, ElfW(Addr) address)
{
  char digits[2 * sizeof address];
  size_t count = 0;
  do {
    digits[count++] = "0123456789abcdef"[address & 15];
    address >>= 4;
  } while (address);
  *text++ = '0';
  *text++ = 'x';
  while (count) {
    *text++ = digits[--count];
  }
  *text = 0;
}

static void name_frames(char *path, char *addresses[], size_t count)
{
  char *command[MOST_FRAMES + 8] = {"addr2line", "-C", "-f", "-i", "-e", path};
  size_t size = 6;
  for (size_t i = 0; i < count; i++) {
    command[size++] = addresses[i];
  }
  pid_t child = _Fork();
  if (child == 0) {
    dup2(tap, STDOUT_FILENO);
    int nothing = open("/dev/null", O_WRONLY);
    dup2(nothing, STDERR_FILENO);
    execv("/usr/bin/addr2line", command);
    _exit(127);
  }
  if (child > 0) {
    waitpid(child, NULL, 0);
  }
}

// Names the frames from one index on, together those of one file.
static void tell_frames(void *frames[], int first, int count)
{
  static struct sought sought;
  static char file[MOST_PATH];
  static char digits[MOST_FRAMES][2 * sizeof(ElfW(Addr)) + 3];
  static char *addresses[MOST_FRAMES];
  size_t number = 0;
  int files = 0;
  file[0] = 0;
  for (int i = first; i < count && files < MOST_FILES; i++) {
    // A caller's address is the one after its call.
    sought.address = (ElfW(Addr))frames[i] - (i > first);
    sought.path[0] = 0;
    dl_iterate_phdr(look, &sought);
    if (!is_below(sought.path)) {
      continue;
    }
    if (number && strcmp(file, sought.path) != 0) {
      name_frames(file, addresses, number);
      files++;
      number = 0;
    }
    strcpy(file, sought.path);
    addresses[number] = digits[number];
    write_address(digits[number], sought.address - sought.base);
    number++;
  }
  if (number && files < MOST_FILES) {
    name_frames(file, addresses, number);
  }
}

static void end_by(int number)
{
  signal(number, SIG_DFL);
  sigset_t one;
  sigemptyset(&one);
  sigaddset(&one, number);
  raise(number);
  sigprocmask(SIG_UNBLOCK, &one, NULL);
}

static void on_timeout(int number)
{
  (void)number;
  end_by(crashed_by);
}

static void on_crash(int number, siginfo_t *info, void *context)
{
  (void)info;
  crashed_by = number;
  signal(SIGALRM, on_timeout);
  sigset_t one;
  sigemptyset(&one);
  sigaddset(&one, SIGALRM);
  sigprocmask(SIG_UNBLOCK, &one, NULL);
  alarm(LONGEST_S);
  void *frames[MOST_FRAMES];
  int count = backtrace(frames, MOST_FRAMES);
  void *at = (void *)((ucontext_t *)context)->uc_mcontext.gregs[REG_RIP];
  int first = 0;
  while (first < count && frames[first] != at) {
    first++;
  }
  tell(BEGIN, sizeof BEGIN - 1);
  tell_frames(frames, first, count);
  tell(END, sizeof END - 1);
  end_by(number);
}

__attribute__((constructor)) static void begin(void)
{
  const char *descriptor = getenv("GRADER_TAP_FD");
  const char *root = getenv("GRADER_CRASH_BELOW");
  ssize_t size = readlink("/proc/self/exe", program, MOST_PATH - 1);
  if (descriptor == NULL || root == NULL || size < 0 || strlen(root) >= MOST_PATH) {
    return;
  }
  strcpy(below, root);
  if (!is_below(program)) {
    return;
  }
  tap = atoi(descriptor);
  // Programs that this one starts are left alone.
  unsetenv("LD_PRELOAD");
  // The first call loads a library.
  void *frames[1];
  backtrace(frames, 1);
  stack_t own = {.ss_sp = stack, .ss_size = STACK_BYTES};
  sigaltstack(&own, NULL);
  for (size_t i = 0; i < sizeof SIGNALS / sizeof *SIGNALS; i++) {
    struct sigaction action = {.sa_sigaction = on_crash, .sa_flags = SA_SIGINFO | SA_ONSTACK | SA_RESETHAND};
    struct sigaction before;
    sigaction(SIGNALS[i], NULL, &before);
    if (before.sa_handler == SIG_DFL) {
      sigaction(SIGNALS[i], &action, NULL);
    }
  }
}
