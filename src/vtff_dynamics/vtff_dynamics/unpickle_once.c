/* Keeps what machine code unpickles: the classes of arrays and named tuples that it returns, and
   exceptions. numba does so in a process that compiles, but modules of numba.pycc unpickle at each
   call, which takes 0.4 us for each array returned. Each module has a table of its own.

   Linked with --wrap=numba_unpickle, which sends the calls of machine code here. */

#include <Python.h>

#define MOST 16

PyObject *__real_numba_unpickle(const char *data, int size, const char *hash);

PyObject *__wrap_numba_unpickle(const char *data, int size, const char *hash)
{
    static struct {
        const char *data; /* address of the constant */
        PyObject *object;
    } known[MOST];
    static int count = 0;
    for (int place = 0; place < count; place++) {
        if (known[place].data == data)
            return Py_NewRef(known[place].object);
    }
    PyObject *object = __real_numba_unpickle(data, size, hash);
    if (object != NULL && count < MOST) {
        known[count].data = data;
        known[count].object = Py_NewRef(object);
        count++;
    }
    return object;
}
