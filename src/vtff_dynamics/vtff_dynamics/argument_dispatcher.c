/* A callable that looks at its arguments and passes them on to the machine code of their forms.

   Forms are those of machine_code._argument_form, which stays the judge of what is not plain: of
   data types with fields or from other libraries, and of the class of a named tuple when it comes
   first. Name and fields of a class do not change afterwards. */

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <stddef.h>
#define NPY_NO_DEPRECATED_API NPY_1_7_API_VERSION
#include <numpy/arrayobject.h>

typedef enum { SCALAR = 0, ARRAY = 1, NAMED_TUPLE = 2 } Kind;

/* What is asked of one argument. */
typedef struct Look {
    int kind;
    PyObject *form;          /* text of _argument_form */
    PyTypeObject *types[2];  /* SCALAR: either; NAMED_TUPLE: the first class of this form, NULL */
    unsigned type_numbers;   /* ARRAY: a bit for each number of a data type of numpy */
    int dimensions, flags_looked_at, flags;
    Py_ssize_t count;        /* NAMED_TUPLE: its members */
    struct Look *members;
} Look;

typedef struct {
    Look *looks; /* one for each argument */
    PyObject *code;
} Entry;

typedef struct {
    PyObject_HEAD
    vectorcallfunc vectorcall;
    Py_ssize_t argument_count, entry_count;
    Entry *entries;
    PyObject *otherwise, *form_of;
} Dispatcher;

/* Return whether _argument_form gives the argument this form; -1 with an exception. */
static int ask(const Look *look, PyObject *argument, PyObject *form_of)
{
    PyObject *form = PyObject_CallOneArg(form_of, argument);
    if (form == NULL)
        return -1;
    int is_same = PyObject_RichCompareBool(form, look->form, Py_EQ);
    Py_DECREF(form);
    return is_same;
}

/* Return whether the argument has the form of the look; -1 with an exception. */
static int matches(Look *look, PyObject *argument, PyObject *form_of)
{
    PyTypeObject *type = Py_TYPE(argument);
    if (look->kind == SCALAR)
        return type == look->types[0] || type == look->types[1];
    if (look->kind == ARRAY) {
        if (!PyArray_CheckExact(argument))
            return 0;
        PyArrayObject *array = (PyArrayObject *)argument;
        if (PyArray_NDIM(array) != look->dimensions
            || (PyArray_FLAGS(array) & look->flags_looked_at) != look->flags)
            return 0;
        PyArray_Descr *data_type = PyArray_DESCR(array);
        int number = data_type->type_num;
        if (number >= 0 && number < 32) {
            if (!(look->type_numbers >> number & 1u))
                return 0;
            if (!PyDataType_HASFIELDS(data_type))
                return PyArray_ISNBO(data_type->byteorder) != 0;
        }
        return ask(look, argument, form_of);
    }
    if (type == look->types[0] && PyTuple_GET_SIZE(argument) == look->count) {
        for (Py_ssize_t place = 0; place < look->count; place++) {
            int is_same = matches(
                &look->members[place], PyTuple_GET_ITEM(argument, place), form_of);
            if (is_same != 1)
                return is_same;
        }
        return 1;
    }
    int is_same = ask(look, argument, form_of);
    if (is_same == 1 && look->types[0] == NULL && PyTuple_Check(argument))
        look->types[0] = (PyTypeObject *)Py_NewRef((PyObject *)type);
    return is_same;
}

static PyObject *dispatch(
    PyObject *callable, PyObject *const *arguments, size_t flagged_count, PyObject *names)
{
    Dispatcher *self = (Dispatcher *)callable;
    Py_ssize_t count = PyVectorcall_NARGS(flagged_count);
    if (names != NULL && PyTuple_GET_SIZE(names) > 0) {
        PyErr_SetString(PyExc_TypeError, "a compiled function takes no arguments by name");
        return NULL;
    }
    if (count != self->argument_count) {
        PyErr_Format(PyExc_TypeError, "a compiled function of %zd arguments got %zd",
                     self->argument_count, count);
        return NULL;
    }
    PyObject *function = self->otherwise;
    for (Py_ssize_t number = 0; number < self->entry_count; number++) {
        Look *looks = self->entries[number].looks;
        int is_same = 1;
        for (Py_ssize_t place = 0; place < count && is_same == 1; place++)
            is_same = matches(&looks[place], arguments[place], self->form_of);
        if (is_same < 0)
            return NULL;
        if (is_same) {
            function = self->entries[number].code;
            break;
        }
    }
    return PyObject_Vectorcall(function, arguments, (size_t)count, NULL);
}

static int visit_look(Look *look, visitproc visit, void *arg)
{
    Py_VISIT(look->types[0]);
    Py_VISIT(look->types[1]);
    for (Py_ssize_t place = 0; look->members != NULL && place < look->count; place++) {
        int stop = visit_look(&look->members[place], visit, arg);
        if (stop)
            return stop;
    }
    return 0;
}

static void release_look(Look *look)
{
    Py_CLEAR(look->form);
    Py_CLEAR(look->types[0]);
    Py_CLEAR(look->types[1]);
    for (Py_ssize_t place = 0; look->members != NULL && place < look->count; place++)
        release_look(&look->members[place]);
    PyMem_Free(look->members);
    look->members = NULL;
}

static int traverse(PyObject *object, visitproc visit, void *arg)
{
    Dispatcher *self = (Dispatcher *)object;
    Py_VISIT(self->otherwise);
    Py_VISIT(self->form_of);
    for (Py_ssize_t number = 0; number < self->entry_count; number++) {
        Entry *entry = &self->entries[number];
        Py_VISIT(entry->code);
        for (Py_ssize_t place = 0; entry->looks != NULL && place < self->argument_count; place++) {
            int stop = visit_look(&entry->looks[place], visit, arg);
            if (stop)
                return stop;
        }
    }
    return 0;
}

/* Not tp_clear: a circle through a dispatcher is broken in the Python objects that it refers to. */
static void deallocate(PyObject *object)
{
    Dispatcher *self = (Dispatcher *)object;
    PyObject_GC_UnTrack(object);
    for (Py_ssize_t number = 0; number < self->entry_count; number++) {
        Entry *entry = &self->entries[number];
        for (Py_ssize_t place = 0; entry->looks != NULL && place < self->argument_count; place++)
            release_look(&entry->looks[place]);
        PyMem_Free(entry->looks);
        Py_CLEAR(entry->code);
    }
    PyMem_Free(self->entries);
    Py_CLEAR(self->otherwise);
    Py_CLEAR(self->form_of);
    PyObject_GC_Del(object);
}

/* Return zeroed memory of at least one byte; NULL with an exception. */
static void *zeroed(Py_ssize_t count, size_t size)
{
    void *memory = PyMem_Calloc(count ? (size_t)count : 1, size);
    return memory != NULL ? memory : PyErr_NoMemory();
}

/* Layout C includes what is of layout F, too; A is neither. */
static void read_flags(Look *look, char layout, int is_readonly)
{
    look->flags_looked_at = NPY_ARRAY_ALIGNED | NPY_ARRAY_WRITEABLE | NPY_ARRAY_C_CONTIGUOUS
                            | (layout == 'C' ? 0 : NPY_ARRAY_F_CONTIGUOUS);
    look->flags = NPY_ARRAY_ALIGNED | (is_readonly ? 0 : NPY_ARRAY_WRITEABLE)
                  | (layout == 'C' ? NPY_ARRAY_C_CONTIGUOUS : 0)
                  | (layout == 'F' ? NPY_ARRAY_F_CONTIGUOUS : 0);
}

/* Read looks from a tuple of tuples; NULL with an exception. `release_look` frees what was read. */
static Look *read_looks(PyObject *described)
{
    Py_ssize_t count = PyTuple_GET_SIZE(described);
    Look *looks = zeroed(count, sizeof(Look));
    for (Py_ssize_t place = 0; looks != NULL && place < count; place++) {
        Look *look = &looks[place];
        PyObject *each = PyTuple_GET_ITEM(described, place), *form, *rest;
        int is_read = PyTuple_Check(each)
                      && PyArg_ParseTuple(each, "iUO!", &look->kind, &form, &PyTuple_Type, &rest);
        if (is_read)
            look->form = Py_NewRef(form);
        if (is_read && look->kind == SCALAR) {
            PyObject *first, *second;
            is_read = PyArg_ParseTuple(
                rest, "O!O!", &PyType_Type, &first, &PyType_Type, &second);
            if (is_read) {
                look->types[0] = (PyTypeObject *)Py_NewRef(first);
                look->types[1] = (PyTypeObject *)Py_NewRef(second);
            }
        } else if (is_read && look->kind == ARRAY) {
            const char *layout;
            int is_readonly;
            is_read = PyArg_ParseTuple(
                rest, "Iisp", &look->type_numbers, &look->dimensions, &layout, &is_readonly);
            if (is_read)
                read_flags(look, layout[0], is_readonly);
        } else if (is_read) {
            look->members = read_looks(rest);
            look->count = PyTuple_GET_SIZE(rest);
            is_read = look->members != NULL;
        }
        if (!is_read) {
            if (!PyErr_Occurred())
                PyErr_SetString(PyExc_TypeError, "looks: tuples expected");
            for (Py_ssize_t read = 0; read <= place; read++)
                release_look(&looks[read]);
            PyMem_Free(looks);
            return NULL;
        }
    }
    return looks;
}

static PyTypeObject dispatcher_type = {
    PyVarObject_HEAD_INIT(NULL, 0)
    .tp_name = "vtff_argument_dispatcher.Dispatcher",
    .tp_basicsize = sizeof(Dispatcher),
    .tp_flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC | Py_TPFLAGS_HAVE_VECTORCALL,
    .tp_vectorcall_offset = offsetof(Dispatcher, vectorcall),
    .tp_call = PyVectorcall_Call,
    .tp_traverse = traverse,
    .tp_dealloc = deallocate,
};

/* dispatcher(argument_count, entries, otherwise, form_of), entries being pairs (looks, code). */
static PyObject *make_dispatcher(PyObject *module, PyObject *arguments)
{
    Py_ssize_t argument_count;
    PyObject *entries, *otherwise, *form_of;
    if (!PyArg_ParseTuple(arguments, "nO!OO", &argument_count, &PyTuple_Type, &entries, &otherwise,
                          &form_of))
        return NULL;
    Dispatcher *self = PyObject_GC_New(Dispatcher, &dispatcher_type);
    if (self == NULL)
        return NULL;
    self->vectorcall = dispatch;
    self->argument_count = argument_count;
    self->entry_count = 0;
    self->otherwise = Py_NewRef(otherwise);
    self->form_of = Py_NewRef(form_of);
    self->entries = zeroed(PyTuple_GET_SIZE(entries), sizeof(Entry));
    int is_read = self->entries != NULL;
    for (Py_ssize_t number = 0; is_read && number < PyTuple_GET_SIZE(entries); number++) {
        PyObject *looks, *code;
        is_read = PyArg_ParseTuple(PyTuple_GET_ITEM(entries, number), "O!O", &PyTuple_Type, &looks,
                                   &code);
        if (is_read && PyTuple_GET_SIZE(looks) != argument_count) {
            PyErr_SetString(PyExc_ValueError, "a compiled function has one number of arguments");
            is_read = 0;
        }
        if (!is_read)
            break;
        self->entries[number].looks = read_looks(looks);
        is_read = self->entries[number].looks != NULL;
        if (is_read) {
            self->entries[number].code = Py_NewRef(code);
            self->entry_count++;
        }
    }
    PyObject_GC_Track((PyObject *)self);
    if (is_read)
        return (PyObject *)self;
    Py_DECREF(self);
    return NULL;
}

static PyMethodDef methods[] = {
    {"dispatcher", make_dispatcher, METH_VARARGS, NULL},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, .m_name = "vtff_argument_dispatcher", .m_size = -1, .m_methods = methods,
};

PyMODINIT_FUNC PyInit_vtff_argument_dispatcher(void)
{
    import_array();
    if (PyType_Ready(&dispatcher_type) < 0)
        return NULL;
    return PyModule_Create(&definition);
}
