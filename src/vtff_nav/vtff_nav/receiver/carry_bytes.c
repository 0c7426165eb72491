/* Carries bytes from one descriptor to another without the interpreter lock of Python.

   A pseudo-terminal gives 4 kB at a read, and a read waits until the kernel has refilled it. Done in
   a thread with the lock free, that goes on while Python works. */

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <errno.h>
#include <poll.h>
#include <unistd.h>

#define READ_LENGTH 65536

/* Return whether all bytes were written; room in a full pipe is waited for until `stop`. */
static int write_all(int sink, int stop, const char *bytes, ssize_t count)
{
    while (count > 0) {
        ssize_t written = write(sink, bytes, count);
        if (written > 0) {
            bytes += written;
            count -= written;
        } else if (written < 0 && errno == EAGAIN) {
            struct pollfd watched[2] = {{sink, POLLOUT, 0}, {stop, POLLIN, 0}};
            if ((poll(watched, 2, -1) < 0 && errno != EINTR) || watched[1].revents)
                return 0;
        } else if (written < 0 && errno != EINTR) {
            return 0;
        }
    }
    return 1;
}

static void carry_on(int source, int sink, int stop)
{
    char bytes[READ_LENGTH];
    for (;;) {
        struct pollfd watched[2] = {{source, POLLIN, 0}, {stop, POLLIN, 0}};
        if (poll(watched, 2, -1) < 0) {
            if (errno == EINTR)
                continue;
            return;
        }
        if (watched[1].revents || !(watched[0].revents & POLLIN))
            return;
        ssize_t count = read(source, bytes, READ_LENGTH);
        if (count > 0) {
            if (!write_all(sink, stop, bytes, count))
                return;
        } else if ((watched[0].revents & (POLLHUP | POLLERR))
                   || (count < 0 && errno != EINTR && errno != EAGAIN)) {
            return;
        }
    }
}

static PyObject *carry(PyObject *module, PyObject *arguments)
{
    int source, sink, stop;
    if (!PyArg_ParseTuple(arguments, "iii", &source, &sink, &stop))
        return NULL;
    Py_BEGIN_ALLOW_THREADS
    carry_on(source, sink, stop);
    Py_END_ALLOW_THREADS
    Py_RETURN_NONE;
}

static PyMethodDef methods[] = {
    {"carry", carry, METH_VARARGS,
     "Carry bytes between descriptors until the source is lost or `stop` is readable."},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {PyModuleDef_HEAD_INIT, "vtff_carry_bytes", NULL, -1, methods};

PyMODINIT_FUNC PyInit_vtff_carry_bytes(void)
{
    return PyModule_Create(&definition);
}
