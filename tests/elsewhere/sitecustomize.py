"""Makes a Python on Linux as bare as one on Windows, for every process that has this folder on its PYTHONPATH.

What only POSIX has is gone for mjsim: modules, functions of ``os``, signals. Other packages keep it, since they ask
``sys.platform`` first. A text file without an encoding is in cp1252, with CRLF. A file cannot be moved or removed while
this process has it open. Names that Windows cannot have are refused.
"""

import builtins
import io
import os
import signal
import sys
import warnings

MODULES = "fcntl resource pwd grp spwd termios tty pty syslog crypt nis ossaudiodev readline curses".split()
FUNCTIONS = """chown chroot confstr ctermid eventfd fchdir fchmod fchown fork forkpty fstatvfs getegid geteuid getgid
getgrouplist getgroups getloadavg getpgid getpgrp getpriority getresgid getresuid getsid getuid initgroups killpg lchown
lockf major makedev memfd_create minor mkfifo mknod nice openpty pathconf pipe2 posix_fadvise posix_fallocate
posix_spawn pread pwrite readv sched_getaffinity sched_setaffinity sched_yield sendfile setegid seteuid setgid setgroups
setpgid setpriority setregid setreuid setsid setuid statvfs sync sysconf tcgetpgrp tcsetpgrp ttyname uname wait wait3
wait4 writev""".split()
SIGNALS = """SIGALRM SIGBUS SIGCHLD SIGCONT SIGHUP SIGIO SIGKILL SIGPIPE SIGPROF SIGQUIT SIGSTOP SIGSYS SIGTRAP SIGTSTP
SIGTTIN SIGTTOU SIGURG SIGUSR1 SIGUSR2 SIGVTALRM SIGWINCH SIGXCPU SIGXFSZ setitimer getitimer alarm pause pthread_kill
pthread_sigmask sigpending sigtimedwait sigwait sigwaitinfo""".split()

import_ = builtins.__import__


def ours(depth=2):
    """Whether code of mjsim asks."""
    return sys._getframe(depth).f_globals.get("__name__", "").partition(".")[0] in ("mjsim", "__main__")


def imported(name, *more, **named):
    if name in MODULES and ours():
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    return import_(name, *more, **named)


def hide(place, names):
    """Let mjsim see none of the names of a module."""
    hidden = {name: vars(place).pop(name) for name in names if name in vars(place)}

    def get(name):
        if name in hidden and not ours():
            return hidden[name]
        raise AttributeError(f"module {place.__name__!r} has no attribute {name!r}")

    place.__getattr__ = get


builtins.__import__ = imported
hide(os, FUNCTIONS)
hide(signal, SIGNALS)
warnings.filterwarnings("error", category=EncodingWarning, module=r"mjsim\b")
opened, low_level, replace, unlink, rename, makedir = io.open, os.open, os.replace, os.unlink, os.rename, os.mkdir


def legal(path):
    """The same path, if Windows can have its name."""
    if isinstance(path, (str, os.PathLike)):
        name = os.path.basename(os.fspath(path))
        if set(name) & set('<>:"|?*') or name.endswith(" ") or (name.endswith(".") and name.strip(".")):
            raise OSError(22, "Invalid argument", os.fspath(path))
    return path


def open_(file, mode="r", buffering=-1, encoding=None, errors=None, newline=None, closefd=True, opener=None):
    if "b" not in mode and isinstance(file, (str, os.PathLike)):
        encoding = "cp1252" if encoding in (None, "locale") else encoding
        newline = "\r\n" if newline is None and "r" not in mode else newline
    return opened(file if mode[0] == "r" else legal(file), mode, buffering, encoding, errors, newline, closefd, opener)


def free(path):
    """The same path, if no file of this process is open there."""
    real = os.path.realpath(path)
    for number in os.listdir("/proc/self/fd"):
        try:
            if os.readlink(f"/proc/self/fd/{number}") == real:
                raise PermissionError(13, "The process cannot access the file", os.fspath(path))
        except FileNotFoundError:
            continue
    return path


def unlinked(path, *, dir_fd=None):
    return unlink(free(path) if dir_fd is None else path, dir_fd=dir_fd)


builtins.open = io.open = open_
os.open = lambda path, flags, mode=0o777, *, dir_fd=None: low_level(legal(path), flags, mode, dir_fd=dir_fd)
os.mkdir = lambda path, mode=0o777, *, dir_fd=None: makedir(legal(path), mode, dir_fd=dir_fd)
os.replace = lambda source, target: replace(free(source), legal(free(target)))
os.rename = lambda source, target: rename(free(source), legal(free(target)))
os.unlink = os.remove = unlinked
