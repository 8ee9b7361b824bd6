/* The C controller as a Python type: `firmware_sim.c._native.Controller`. Scalars are read straight from the state. */
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include "ctl_parts.h"
#include "elbow.h"
#include "flat.h"

#define MOST_FRAMES 1024
#define MOST_TICKS 64 /* of one call of `coast` */
#define ROW 4         /* numbers that it tells of each */
#ifndef CTL_DIGEST
#define CTL_DIGEST "" /* of the sources; setup.py gives it */
#endif

typedef struct {
    PyObject_HEAD
    ctl_state state;
    PyObject *outbox;
    PyObject *counters;
    uint32_t counted[CTL_COUNTERS];
} Controller;

typedef struct {
    PyObject_HEAD
    Controller *owner;
} Law;

static PyObject *names_of_state, *names_of_reason, *names_of_refusal; /* tuples of the members, set from Python */

static PyObject *as_bool(int64_t value) { return PyBool_FromLong(value != 0); }
static PyObject *as_int(int64_t value) { return PyLong_FromLongLong(value); }
#define BOXED(value) _Generic((value), bool: as_bool, default: as_int)((int64_t)(value))

static PyTypeObject ControllerType, LawType;

/* The torque law's memory: a view, as live as the state. */

#define X(name) \
    static PyObject *law_##name(PyObject *self, void *u) { (void)u; return BOXED(((Law *)self)->owner->state.torque.name); }
FLAT_LAW(X)
#undef X

static PyGetSetDef law_fields[] = {
#define X(name) {#name, law_##name, NULL, NULL, NULL},
    FLAT_LAW(X)
#undef X
    {NULL, NULL, NULL, NULL, NULL}};

static void law_free(PyObject *self) {
    Py_DECREF(((Law *)self)->owner);
    Py_TYPE(self)->tp_free(self);
}

/* Controller */

static PyObject *member(PyObject *members, uint8_t value) {
    if (members == NULL || value >= PyTuple_GET_SIZE(members)) {
        return PyLong_FromLong(value);
    }
    return Py_NewRef(PyTuple_GET_ITEM(members, value));
}

#define X(name) \
    static PyObject *get_##name(PyObject *self, void *u) { (void)u; return BOXED(((Controller *)self)->state.name); }
FLAT_PLAIN(X)
#undef X

static PyObject *named_state(PyObject *self, void *u) { (void)u; return member(names_of_state, ((Controller *)self)->state.state); }
static PyObject *named_reason(PyObject *self, void *u) { (void)u; return member(names_of_reason, ((Controller *)self)->state.reason); }
static PyObject *named_refusal(PyObject *self, void *u) { (void)u; return member(names_of_refusal, ((Controller *)self)->state.refusal); }

static PyObject *get_torque(PyObject *self, void *u) {
    (void)u;
    Law *law = PyObject_New(Law, &LawType);
    if (law != NULL) {
        law->owner = (Controller *)Py_NewRef(self);
    }
    return (PyObject *)law;
}

static PyObject *get_counters(PyObject *self, void *u) {
    (void)u;
    Controller *c = (Controller *)self;
    if (c->counters != NULL && memcmp(c->counted, c->state.counters, sizeof c->counted) == 0) {
        return Py_NewRef(c->counters);
    }
    PyObject *made = PyTuple_New(CTL_COUNTERS);
    for (Py_ssize_t at = 0; made != NULL && at < CTL_COUNTERS; at++) {
        PyTuple_SET_ITEM(made, at, PyLong_FromUnsignedLong(c->state.counters[at]));
    }
    if (made != NULL) {
        memcpy(c->counted, c->state.counters, sizeof c->counted);
        Py_XSETREF(c->counters, Py_NewRef(made));
    }
    return made;
}

static PyObject *get_trips(PyObject *self, void *u) {
    (void)u;
    const ctl_state *s = &((Controller *)self)->state;
    PyObject *made = PyTuple_New(s->trip_count);
    for (Py_ssize_t at = 0; made != NULL && at < s->trip_count; at++) {
        PyTuple_SET_ITEM(made, at, PyLong_FromLongLong(s->trips[at]));
    }
    return made;
}

static PyObject *get_key(PyObject *self, void *u) {
    (void)u;
    const ctl_state *s = &((Controller *)self)->state;
    return PyBytes_FromStringAndSize((const char *)s->key, s->armed ? CTL_KEY_LENGTH : 0);
}

static PyObject *machine(PyObject *self, PyObject *slot) {
    long which = PyLong_AsLong(slot);
    if (which < 0 || which >= CTL_RECEIVED_COUNT) {
        PyErr_SetString(PyExc_IndexError, "no such message");
        return NULL;
    }
    return PyLong_FromLong(((Controller *)self)->state.receivers[which].machine);
}

static PyObject *made_outbox(const ctl_state *s) {
    PyObject *made = PyTuple_New(s->outbox_count);
    for (Py_ssize_t at = 0; made != NULL && at < s->outbox_count; at++) {
        const ctl_sent *sent = &s->outbox[at];
        PyObject *pair = Py_BuildValue("Hy#", sent->can_id, sent->data, (Py_ssize_t)CTL_FRAME_LENGTH);
        if (pair == NULL) {
            Py_DECREF(made);
            return NULL;
        }
        PyTuple_SET_ITEM(made, at, pair);
    }
    return made;
}

static PyObject *get_outbox(PyObject *self, void *u) {
    (void)u;
    return Py_NewRef(((Controller *)self)->outbox);
}

static PyGetSetDef controller_fields[] = {
    {"state", named_state, NULL, NULL, NULL},
    {"reason", named_reason, NULL, NULL, NULL},
    {"refusal", named_refusal, NULL, NULL, NULL},
    {"torque", get_torque, NULL, NULL, NULL},
    {"counters", get_counters, NULL, NULL, NULL},
    {"trips", get_trips, NULL, NULL, NULL},
    {"key", get_key, NULL, NULL, NULL},
    {"outbox", get_outbox, NULL, NULL, NULL},
#define X(name) {#name, get_##name, NULL, NULL, NULL},
    FLAT_PLAIN(X)
#undef X
    {NULL, NULL, NULL, NULL, NULL}};

/* Inputs: an attribute of firmware_sim.memory.Inputs each; what no sensor gives saturates. */

static const char *const INPUT_NAMES[] = {
    "frames", "angle_mdeg", "second_angle_mdeg", "velocity_mdeg_s", "user_torque_unm", "measured_unm", "commanded_unm",
    "random_u32", "bus_off", "self_test_ok", "local_clear", "stall_ticks", "tx_dropped"};
enum { IN_FRAMES, IN_ANGLE, IN_SECOND, IN_VELOCITY, IN_USER, IN_MEASURED, IN_COMMANDED, IN_RANDOM, IN_BUS_OFF, IN_SELF_TEST, IN_CLEAR, IN_STALL, IN_DROPPED, IN_COUNT };
static PyObject *input_names[IN_COUNT];

static int64_t number(PyObject *inputs, int which, int64_t lowest, int64_t highest) {
    PyObject *value = PyObject_GetAttr(inputs, input_names[which]);
    int overflow = 0;
    long long found = value == NULL ? -1 : PyLong_AsLongLongAndOverflow(value, &overflow);
    Py_XDECREF(value);
    if (overflow != 0) {
        return overflow < 0 ? lowest : highest;
    }
    return ctl_max(lowest, ctl_min(found, highest));
}

static int32_t reading(PyObject *inputs, int which) { return (int32_t)number(inputs, which, INT32_MIN, INT32_MAX); }
static uint32_t amount(PyObject *inputs, int which) { return (uint32_t)number(inputs, which, 0, UINT32_MAX); }

/* Fill in a frame from a Received (can_id, data, plain); false with an exception set where it is none. */
static bool take_frame(PyObject *received, ctl_frame *frame) {
    if (!PyTuple_Check(received) || PyTuple_GET_SIZE(received) != 3 || !PyBytes_Check(PyTuple_GET_ITEM(received, 1))) {
        PyErr_SetString(PyExc_TypeError, "a frame is Received(can_id, data, plain)");
        return false;
    }
    PyObject *data = PyTuple_GET_ITEM(received, 1);
    Py_ssize_t length = PyBytes_GET_SIZE(data);
    frame->can_id = (uint32_t)PyLong_AsUnsignedLong(PyTuple_GET_ITEM(received, 0));
    frame->plain = PyObject_IsTrue(PyTuple_GET_ITEM(received, 2)) == 1;
    frame->length = (uint8_t)(length < 255 ? length : 255);
    memset(frame->data, 0, CTL_FRAME_LENGTH);
    memcpy(frame->data, PyBytes_AS_STRING(data), (size_t)(length < CTL_FRAME_LENGTH ? length : CTL_FRAME_LENGTH));
    return !PyErr_Occurred();
}

static bool take_frames(PyObject *frames, ctl_frame *to, size_t *count) {
    if (!PyTuple_Check(frames) || PyTuple_GET_SIZE(frames) > MOST_FRAMES) {
        PyErr_Format(PyExc_ValueError, "frames: a tuple of at most %d", MOST_FRAMES);
        return false;
    }
    for (Py_ssize_t at = 0; at < PyTuple_GET_SIZE(frames); at++) {
        if (!take_frame(PyTuple_GET_ITEM(frames, at), &to[at])) {
            return false;
        }
    }
    *count = (size_t)PyTuple_GET_SIZE(frames);
    return true;
}

static PyObject *advance(PyObject *self, PyObject *const *args, Py_ssize_t given) {
    Controller *c = (Controller *)self;
    ctl_frame frames[MOST_FRAMES];
    ctl_outputs outputs;
    if (given != 2) {
        PyErr_SetString(PyExc_TypeError, "advance(inputs, now_ms)");
        return NULL;
    }
    PyObject *in = args[0];
    ctl_inputs inputs = {
        .frames = frames, .now_ms = PyLong_AsLongLong(args[1]),
        .angle_mdeg = reading(in, IN_ANGLE), .second_angle_mdeg = reading(in, IN_SECOND),
        .velocity_mdeg_s = reading(in, IN_VELOCITY), .user_torque_unm = reading(in, IN_USER),
        .measured_unm = reading(in, IN_MEASURED), .commanded_unm = reading(in, IN_COMMANDED),
        .random_u32 = amount(in, IN_RANDOM), .stall_ticks = amount(in, IN_STALL), .tx_dropped = amount(in, IN_DROPPED),
        .bus_off = amount(in, IN_BUS_OFF) != 0, .self_test_ok = amount(in, IN_SELF_TEST) != 0,
        .local_clear = amount(in, IN_CLEAR) != 0};
    PyObject *received = PyErr_Occurred() ? NULL : PyObject_GetAttr(in, input_names[IN_FRAMES]);
    bool taken = received != NULL && take_frames(received, frames, &inputs.count);
    Py_XDECREF(received);
    if (!taken) {
        return NULL;
    }
    ctl_step(&c->state, &inputs, &outputs);
    PyObject *outbox = made_outbox(&c->state);
    if (outbox == NULL) {
        return NULL;
    }
    Py_XSETREF(c->outbox, outbox);
    Py_RETURN_NONE;
}

/* Ticks without frames, with the simulated elbow: one call for a stretch in which nothing happens. */

/* What somebody may want to hear of at once: more than that time went by. */
typedef struct {
    uint8_t state, reason;
    bool armed, assists, carries;
    uint32_t trips;
} mark;

static mark mark_of(const ctl_state *s) {
    return (mark){s->state, s->reason, s->armed, s->torque.assist_unm != 0, s->torque.gravity_unm != 0, s->counters[CTL_COUNT_TRIPS]};
}

static bool same(mark a, mark b) {
    return a.state == b.state && a.reason == b.reason && a.armed == b.armed && a.assists == b.assists &&
           a.carries == b.carries && a.trips == b.trips;
}

/* Step until something happens or `most` ticks are over: how many there were. Angle, velocity, assist and support after each. */
static long stretch(ctl_state *s, elbow *one, ctl_inputs *inputs, long ticks, long most, double *after, int64_t *peak) {
    mark before = mark_of(s);
    long done = 0;
    bool quiet = true;
    while (done < most && quiet) {
        ctl_outputs outputs;
        double wearer_nm = elbow_wearer_nm(one, (double)(ticks + done + 1) * ELBOW_TICK_S);
        elbow_read(one, wearer_nm, inputs);
        inputs->now_ms++;
        ctl_step(s, inputs, &outputs);
        elbow_move(one, wearer_nm, &outputs);
        *peak = ctl_max(*peak, ctl_abs(outputs.assist_unm));
        after[ROW * done] = one->angle;
        after[ROW * done + 1] = one->velocity;
        after[ROW * done + 2] = (double)outputs.assist_unm;
        after[ROW * done + 3] = (double)outputs.gravity_unm;
        done++;
        quiet = outputs.count == 0 && same(mark_of(s), before);
    }
    return done;
}

static PyObject *reals(const double *values, Py_ssize_t count) {
    PyObject *made = PyTuple_New(count);
    for (Py_ssize_t at = 0; made != NULL && at < count; at++) {
        PyTuple_SET_ITEM(made, at, PyFloat_FromDouble(values[at]));
    }
    return made;
}

static PyObject *coast(PyObject *self, PyObject *args) {
    Controller *c = (Controller *)self;
    elbow one;
    ctl_inputs inputs = {0};
    long ticks, skipped, most;
    long long offset, commanded, peak;
    int self_test_ok, bus_off;
    double after[ROW * MOST_TICKS];
    if (!PyArg_ParseTuple(args, "(lll)(ldddddddLL)ppL", &ticks, &skipped, &most, &one.wearer, &one.angle, &one.velocity,
                          &one.torque_nm, &one.gain, &one.lag_s, &one.bias_nm, &one.extra_nm, &offset, &commanded,
                          &self_test_ok, &bus_off, &peak)) {
        return NULL;
    }
    one.encoder_offset_mdeg = offset;
    one.commanded_unm = commanded;
    inputs.now_ms = ticks + skipped;
    inputs.self_test_ok = self_test_ok;
    inputs.bus_off = bus_off;
    int64_t highest = peak;
    long done = stretch(&c->state, &one, &inputs, ticks, most < MOST_TICKS ? most : MOST_TICKS, after, &highest);
    PyObject *outbox = made_outbox(&c->state), *path = reals(after, ROW * done);
    if (outbox == NULL || path == NULL) {
        Py_XDECREF(outbox);
        Py_XDECREF(path);
        return NULL;
    }
    Py_XSETREF(c->outbox, outbox);
    return Py_BuildValue("ldLLN", done, one.torque_nm, (long long)one.commanded_unm, (long long)highest, path);
}

/* The whole state as whole numbers. */

static PyObject *dump(PyObject *self, PyObject *unused) {
    (void)unused;
    int64_t flat[FLAT_ROOM];
    size_t count = flat_dump(&((Controller *)self)->state, flat);
    PyObject *made = PyTuple_New((Py_ssize_t)count);
    for (size_t at = 0; made != NULL && at < count; at++) {
        PyTuple_SET_ITEM(made, (Py_ssize_t)at, PyLong_FromLongLong(flat[at]));
    }
    return made;
}

static bool numbers_of(PyObject *tuple, int64_t *flat) {
    memset(flat, 0, FLAT_ROOM * sizeof *flat);
    if (!PyTuple_Check(tuple) || PyTuple_GET_SIZE(tuple) > FLAT_ROOM) {
        PyErr_SetString(PyExc_ValueError, "not a flat state");
        return false;
    }
    for (Py_ssize_t at = 0; at < PyTuple_GET_SIZE(tuple); at++) {
        flat[at] = PyLong_AsLongLong(PyTuple_GET_ITEM(tuple, at));
    }
    return !PyErr_Occurred();
}

static PyObject *load(PyObject *self, PyObject *tuple) {
    Controller *c = (Controller *)self;
    int64_t flat[FLAT_ROOM];
    if (!numbers_of(tuple, flat)) {
        return NULL;
    }
    flat_load(&c->state, flat);
    PyObject *outbox = made_outbox(&c->state);
    if (outbox == NULL) {
        return NULL;
    }
    Py_XSETREF(c->outbox, outbox);
    Py_RETURN_NONE;
}

/* -1 where the state is the one in the tuple; else the place of the first number that differs. */
static PyObject *differs(PyObject *self, PyObject *tuple) {
    int64_t mine[FLAT_ROOM], theirs[FLAT_ROOM];
    if (!numbers_of(tuple, theirs)) {
        return NULL;
    }
    size_t count = flat_dump(&((Controller *)self)->state, mine);
    long at = -1;
    if (count != (size_t)PyTuple_GET_SIZE(tuple)) {
        at = (long)count;
    }
    for (size_t which = 0; which < count; which++) {
        if (mine[which] != theirs[which]) {
            at = (long)which;
            break;
        }
    }
    return PyLong_FromLong(at);
}

static PyObject *copied(PyObject *self, PyObject *unused) {
    (void)unused;
    Controller *c = (Controller *)self;
    Controller *twin = (Controller *)Py_TYPE(self)->tp_alloc(Py_TYPE(self), 0);
    if (twin != NULL) {
        twin->state = c->state;
        twin->outbox = Py_NewRef(c->outbox);
    }
    return (PyObject *)twin;
}

static PyMethodDef controller_methods[] = {
    {"advance", (PyCFunction)(void (*)(void))advance, METH_FASTCALL, "advance(inputs, now_ms): one tick, in place."},
    {"coast", coast, METH_VARARGS, "Ticks without frames until one brings something: see firmware_sim/device.py."},
    {"dump", dump, METH_NOARGS, "The whole state as whole numbers; the order is that of flat.py."},
    {"load", load, METH_O, "Become the state that `dump` gave."},
    {"differs", differs, METH_O, "Where a dump differs from this state; -1: nowhere."},
    {"machine", machine, METH_O, "State of the E2E machine of a received message, by its place in RECEIVED_IDS."},
    {"__copy__", copied, METH_NOARGS, "The same moment, to go on from in another way."},
    {NULL, NULL, 0, NULL}};

static PyObject *controller_new(PyTypeObject *type, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"shared_key", "boot_nonce", "limits", NULL};
    const char *key;
    Py_ssize_t length;
    unsigned long nonce;
    PyObject *limits = NULL;
    ctl_limits bounds = ctl_default_limits;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "y#k|O", names, &key, &length, &nonce, &limits)) {
        return NULL;
    }
    if (length != CTL_KEY_LENGTH) {
        PyErr_SetString(PyExc_ValueError, "shared_key: 16 bytes");
        return NULL;
    }
    if (limits != NULL) {
        const char *fields[] = {"angle_low_mdeg", "angle_high_mdeg", "speed_limit_mdeg_s", "tracking_limit_unm"};
        int64_t *places[] = {&bounds.angle_low_mdeg, &bounds.angle_high_mdeg, &bounds.speed_limit_mdeg_s, &bounds.tracking_limit_unm};
        for (int at = 0; at < 4; at++) {
            PyObject *value = PyObject_GetAttrString(limits, fields[at]);
            *places[at] = value == NULL ? -1 : PyLong_AsLongLong(value);
            Py_XDECREF(value);
        }
        if (PyErr_Occurred()) {
            return NULL;
        }
    }
    Controller *c = (Controller *)type->tp_alloc(type, 0);
    if (c == NULL) {
        return NULL;
    }
    c->outbox = PyTuple_New(0);
    if (!ctl_init(&c->state, (const uint8_t *)key, (uint32_t)nonce, &bounds)) {
        PyErr_SetString(PyExc_ValueError, "limits: out of bounds");
        Py_DECREF(c);
        return NULL;
    }
    return (PyObject *)c;
}

static void controller_free(PyObject *self) {
    Controller *c = (Controller *)self;
    Py_XDECREF(c->outbox);
    Py_XDECREF(c->counters);
    Py_TYPE(self)->tp_free(self);
}

static PyTypeObject ControllerType = {
    PyVarObject_HEAD_INIT(NULL, 0).tp_name = "firmware_sim.c._native.Controller",
    .tp_basicsize = sizeof(Controller),
    .tp_flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_BASETYPE,
    .tp_doc = "All memory of the C controller; read as firmware_sim.memory.ControllerState.",
    .tp_new = controller_new,
    .tp_dealloc = controller_free,
    .tp_methods = controller_methods,
    .tp_getset = controller_fields,
};
static PyTypeObject LawType = {
    PyVarObject_HEAD_INIT(NULL, 0).tp_name = "firmware_sim.c._native.Law",
    .tp_basicsize = sizeof(Law),
    .tp_flags = Py_TPFLAGS_DEFAULT,
    .tp_doc = "The torque law's memory of a controller, as it is now.",
    .tp_dealloc = law_free,
    .tp_getset = law_fields,
};

static PyObject *use_members(PyObject *module, PyObject *args) {
    (void)module;
    PyObject *states, *reasons, *refusals;
    if (!PyArg_ParseTuple(args, "O!O!O!", &PyTuple_Type, &states, &PyTuple_Type, &reasons, &PyTuple_Type, &refusals)) {
        return NULL;
    }
    Py_XSETREF(names_of_state, Py_NewRef(states));
    Py_XSETREF(names_of_reason, Py_NewRef(reasons));
    Py_XSETREF(names_of_refusal, Py_NewRef(refusals));
    Py_RETURN_NONE;
}

static PyObject *cmac(PyObject *module, PyObject *args) {
    (void)module;
    const char *key, *message;
    Py_ssize_t length, size;
    uint8_t mac[16];
    if (!PyArg_ParseTuple(args, "y#y#", &key, &length, &message, &size)) {
        return NULL;
    }
    if (length != CTL_KEY_LENGTH) {
        PyErr_SetString(PyExc_ValueError, "key: 16 bytes");
        return NULL;
    }
    ctl_cmac((const uint8_t *)key, (const uint8_t *)message, (size_t)size, mac);
    return PyBytes_FromStringAndSize((const char *)mac, sizeof mac);
}

static PyObject *aes128(PyObject *module, PyObject *args) {
    (void)module;
    const char *key, *block;
    Py_ssize_t length, size;
    uint8_t out[16];
    if (!PyArg_ParseTuple(args, "y#y#", &key, &length, &block, &size)) {
        return NULL;
    }
    if (length != CTL_KEY_LENGTH || size != 16) {
        PyErr_SetString(PyExc_ValueError, "key and block: 16 bytes each");
        return NULL;
    }
    ctl_aes128((const uint8_t *)key, (const uint8_t *)block, out);
    return PyBytes_FromStringAndSize((const char *)out, sizeof out);
}

static PyMethodDef functions[] = {
    {"use_members", use_members, METH_VARARGS, "Tuples of State, Reason and Refusal, in the order of their values."},
    {"cmac", cmac, METH_VARARGS, "AES-128-CMAC of the C."},
    {"aes128", aes128, METH_VARARGS, "One block of AES-128 of the C."},
    {NULL, NULL, 0, NULL}};

static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "_native", NULL, -1, functions, NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__native(void) {
    for (int at = 0; at < IN_COUNT; at++) {
        input_names[at] = PyUnicode_InternFromString(INPUT_NAMES[at]);
    }
    PyObject *made = PyModule_Create(&module);
    if (made == NULL || PyType_Ready(&ControllerType) < 0 || PyType_Ready(&LawType) < 0 ||
        PyModule_AddObjectRef(made, "Controller", (PyObject *)&ControllerType) < 0) {
        Py_XDECREF(made);
        return NULL;
    }
#define X(name) #name " "
    PyObject *hash = PyLong_FromUnsignedLong(CTL_PROFILES_HASH);
    if (hash == NULL || PyModule_AddObjectRef(made, "PROFILES_HASH", hash) < 0) {
        Py_XDECREF(hash);
        Py_DECREF(made);
        return NULL;
    }
    Py_DECREF(hash);
    PyModule_AddStringConstant(made, "DIGEST", CTL_DIGEST);
    PyModule_AddStringConstant(made, "PLAIN", FLAT_PLAIN(X));
    PyModule_AddStringConstant(made, "LAW", FLAT_LAW(X));
#undef X
    return made;
}
