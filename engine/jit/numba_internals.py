"""All that clearcap touches of Numba beyond its manual, because any release may change it.

`engine.jit.kept_code` uses the names for machine code on disk, this module all others.

Where a saving misses one of its names in the installed Numba, the saving is off and one log line says so: compiling
takes longer, and no bit of a result changes. What clearcap cannot do without ends the import of the engine with
`UnsupportedNumbaError`. docs/speed.md says what each saving buys.

| for | names of Numba |
| --- | --- |
| no settings from the current folder | `_config_fname`, `_env_reloader` |
| eight numbers at a time (`engine.jit.lanes`) | `make_array`, `cast`, `get_dummy_value`, `get_or_insert_function` |
| no wrappers and counts of references that nobody needs | `_nrt`, `no_cfunc_wrapper`, `no_cpython_wrapper` |
| pausing and remembering while a kernel compiles | `_compile_core` |
| remembering choices of built-in functions | `top_or_none`, `get_call_type` |
| callees in the form that callers link | `finalize`, `_raise_if_finalized`, `_finalized`, `_get_module_for_linking`, |
| | `_finalize_dynamic_globals`, `_linking_libraries`, `_reload_init`, `_final_module`, `codegen`, `no_compile`, |
| | `insert_user_function`, `entry_point`, `target_context`, `fndesc`, `mangled_name`, `func_qualname` |
| tuples of arrays by address | `AttributeTemplate`, `infer_getattr`, `lower_getattr_generic`, `get_abi_sizeof`, |
| | `get_data_type`, `data_model_manager`, `get_field_position`, `alloca_once`, `false_bit`, `tuple_getitem`, |
| | `numba_array_adaptor` |
| machine code on disk | `UserProvidedCacheLocator`, `get_suitable_cache_subpath`, `CACHE_LOCATOR_CLASSES` |
| machine code from disk without Numba's own functions | `load_overload`, `_load_overload`, `cache_path`, `flush`, |
| | `_guard_against_spurious_io_errors`, `_impl_class`, `reduce`, `llvm_cpython_wrapper_name`, `initialize`, |
| | `ensure_blas`, `_HAVE_BLAS` |
| machine code that came with the package | `_index_key`, `_impl`, `filename_base`, `locator`, `rebuild`, `load`, |
| | `magic_tuple` |
| knowing which machine code is on disk | `_cache`, `_cache_file`, `_index_path`, `_load_index` |
"""

import gc
import hashlib
import logging
import os
from collections.abc import Iterator
from contextlib import chdir, contextmanager, nullcontext
from functools import cache, reduce
from importlib import import_module
from typing import Any, TypeVar

from llvmlite import ir

from engine.errors import UnsupportedNumbaError

# Numba reads settings from this file in the current folder, where anybody may have put it; they even include the
# processor's instruction set. So Numba is imported from another folder, and never looks for the file again.
SETTINGS = ".numba_config.yaml"


with chdir("/") if os.path.lexists(SETTINGS) else nullcontext():
    import numba
    from numba import types
    from numba.core import cgutils, config
    from numba.extending import NativeValue, models, register_model, typeof_impl, unbox

SUPPORTED = ">=0.66,<0.69"  # as in pyproject.toml

ESSENTIAL = (
    "numba.core.config:_config_fname",
    "numba.core.config:_env_reloader.reset",
    "numba.core.base:BaseContext.make_array",
    "numba.core.base:BaseContext.cast",
    "numba.core.base:BaseContext.get_dummy_value",
    "numba.core.cgutils:get_or_insert_function",
)

# The names that each saving needs, by what is the case without it. A name stands behind its module, or behind an object
# that `_object` makes, and a colon.
LEAN = "kernels get wrappers, count references and pass tuples of arrays by value, which takes time to compile"
HOOK = "nothing is paused or remembered while a kernel compiles, and its callees are compiled one by one"
CHOICES = "a built-in function is chosen anew for each call in a kernel"
CALLEES = "the callees of a kernel are compiled one by one"
TUPLES = "kernels pass tuples of arrays by value"
KEPT = "compiled code is not kept on disk: each process compiles for a minute"
ALONE = (
    "each process loads what Numba compiles with, and SciPy's linear algebra, whether or not it compiles, and a damaged"
    " file of compiled code ends a command"
)
SHIPPED = "compiled code that came with the package is not used: the first command compiles"
INDEX = "each process loads all compiled code when it starts, whether or not it needs it"
SAVINGS = {
    LEAN: (
        "numba.core.options:DefaultOptions._nrt",
        "numba.core.options:DefaultOptions.no_cfunc_wrapper",
        "numba.core.options:DefaultOptions.no_cpython_wrapper",
    ),
    HOOK: ("numba.core.compiler:Compiler._compile_core",),
    CHOICES: (
        "numba.core.targetconfig:ConfigStack.top_or_none",
        "numba.core.types.functions:BaseFunction.get_call_type",
    ),
    CALLEES: (
        "context:codegen",
        "library:finalize",
        "library:_raise_if_finalized",
        "library:_finalized",
        "library:_finalize_dynamic_globals",
        "library:_get_module_for_linking",
        "library:_linking_libraries",
        "library:_reload_init",
        "library:_final_module.link_in",
        "context:insert_user_function",
        "numba.core.compiler:Flags.no_compile",
        "numba.core.compiler:CompileResult.entry_point",
        "numba.core.compiler:CompileResult.target_context",
        "numba.core.compiler:CompileResult.fndesc",
        "numba.core.funcdesc:FunctionDescriptor.mangled_name",
        "function:func_qualname",
    ),
    TUPLES: (
        "numba.core.typing.templates:AttributeTemplate",
        "numba.extending:infer_getattr",
        "numba.extending:lower_getattr_generic",
        "context:get_abi_sizeof",
        "context:get_data_type",
        "context:data_model_manager",
        "numba.core.datamodel.models:StructModel.get_field_position",
        "numba.core.cgutils:alloca_once",
        "numba.core.cgutils:false_bit",
        "numba.core.pythonapi:PythonAPI.tuple_getitem",
        "numba.core.pythonapi:PythonAPI.numba_array_adaptor",
    ),
    KEPT: (
        "numba.core.caching:UserProvidedCacheLocator.get_suitable_cache_subpath",
        "numba.core.config:CACHE_LOCATOR_CLASSES",
    ),
    ALONE: (
        "numba.core.caching:FunctionCache.load_overload",
        "numba.core.caching:FunctionCache._load_overload",
        "numba.core.caching:FunctionCache._guard_against_spurious_io_errors",
        "numba.core.caching:FunctionCache.cache_path",
        "numba.core.caching:FunctionCache.flush",
        "numba.core.caching:FunctionCache._impl_class",
        "numba.core.caching:CompileResultCacheImpl.reduce",
        "numba.core.funcdesc:FunctionDescriptor.llvm_cpython_wrapper_name",
        "numba.core.runtime.nrt:rtsys.initialize",
        "numba.np.linalg:ensure_blas",
    ),
    SHIPPED: (
        "numba.core.caching:FunctionCache._index_key",
        "numba.core.caching:CompileResultCacheImpl.filename_base",
        "numba.core.caching:CompileResultCacheImpl.locator",
        "numba.core.caching:CompileResultCacheImpl.rebuild",
        "numba.core.caching:IndexDataCacheFile.load",
        "numba.core.codegen:CPUCodegen.magic_tuple",
    ),
}
# Only a kernel whose code is kept on disk has these.
OF_A_KERNEL = ("_cache._cache_file._index_path", "_cache._cache_file._load_index")

T = TypeVar("T", bound=type)

_log = logging.getLogger(__name__)


def _object(name: str) -> Any:
    """Return a module of Numba, or an object of Numba of the kind that has a private name."""
    if "." in name:
        return import_module(name)
    context = import_module("numba.core.registry").cpu_target.target_context
    if name == "library":
        return import_module("numba.core.codegen").JITCodeLibrary(context.codegen(), name)
    if name == "function":
        return import_module("numba.core.bytecode").FunctionIdentity.from_function(_object)
    return context


def _find(name: str) -> Any:
    """Return what a name of the tables above stands for; an ImportError or AttributeError if this Numba lacks it."""
    owner, _, path = name.partition(":")
    return reduce(getattr, path.split("."), _object(owner))


def has(saving: str) -> bool:
    """Return whether Numba has all names that a saving needs; otherwise log what is lost."""
    for name in SAVINGS[saving]:
        try:
            _find(name)
        except (ImportError, AttributeError):
            lost(saving, name)
            return False
    return True


@cache
def lost(saving: str, name: str) -> None:
    """Log, once, that a saving is off."""
    _log.warning(
        "%s, because Numba %s has no %s; clearcap is made for numba%s",
        saving,
        numba.__version__,
        name.partition(":")[2],
        SUPPORTED,
    )


for _name in ESSENTIAL:
    try:
        _find(_name)
    except (ImportError, AttributeError) as error:
        raise UnsupportedNumbaError(
            f"clearcap does not run with Numba {numba.__version__}, which has no {_name.replace(':', '.')}; it needs"
            f" numba{SUPPORTED}: pip install 'numba{SUPPORTED}'"
        ) from error

config._config_fname = os.devnull
if os.path.lexists(SETTINGS):  # the program may have imported Numba, and so read the file, before this module
    config._env_reloader.reset()  # type: ignore[no-untyped-call]


# -- options of the decorators, without what this Numba does not know ------------------------------------------------

_is_lean, _is_hooked = has(LEAN), has(HOOK)

# No counting of references, which are none of a kernel's business, and no wrappers that nobody calls.
OPTIONS: dict[str, Any] = {"_nrt": False, "no_cfunc_wrapper": True} if _is_lean else {}


# -- remembering choices of built-in functions -----------------------------------------------------------------------
#
# For each call of a built-in function or operator Numba tries all declared implementations with all possible argument
# types, first in type inference and again in code generation. This took a fifth of the compilation time: the kernels
# contain 20,000 such calls, and hardly a thousand different ones.

_chooses_once = has(CHOICES)
if _chooses_once:
    from numba.core.targetconfig import ConfigStack
    from numba.core.types.functions import BaseFunction

    _choose = BaseFunction.get_call_type


class ChosenFunctions:
    """Numba's choices so far: signatures by function, argument types and compiler options."""

    def __init__(self) -> None:
        self._signatures: dict[Any, Any] = {}
        self._options: list[Any] = []  # all different
        self._numbers: dict[int, tuple[int, Any]] = {}  # by the id of the options, which are kept alive for this

    def choose(self, function: Any, context: Any, arguments: Any, named: Any) -> Any:
        """Return the signature with which a function is called, as ``get_call_type`` of Numba's functions does."""
        options = ConfigStack.top_or_none()  # type: ignore[no-untyped-call]
        key = id(function), id(context), self._number(options), arguments, tuple(named.items())
        if key not in self._signatures:
            self._signatures[key] = _choose(function, context, arguments, named), function
        return self._signatures[key][0]

    def _number(self, options: Any) -> int:
        """Return a number that is the same for equal compiler options."""
        if id(options) not in self._numbers:
            if options not in self._options:
                self._options.append(options)
            self._numbers[id(options)] = self._options.index(options), options
        return self._numbers[id(options)][0]


@contextmanager
def choices_remembered() -> Iterator[None]:
    """Remember choices inside the block, which holds Numba's lock; nested blocks have no effect."""
    if not _chooses_once or BaseFunction.get_call_type is not _choose:
        yield
        return
    chosen = ChosenFunctions()

    def get_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
        return chosen.choose(self, context, args, kws)

    BaseFunction.get_call_type = get_call_type  # type: ignore[method-assign]
    try:
        yield
    finally:
        BaseFunction.get_call_type = _choose  # type: ignore[method-assign]


# -- how kernels and their callees are compiled ----------------------------------------------------------------------


@contextmanager
def collection_paused() -> Iterator[None]:
    """Pause garbage collection inside the block, which holds Numba's lock; if it was off, it stays off.

    Numba creates millions of small objects, nearly all of which live until the kernel is compiled. The garbage
    collector examined them again and again and found hardly any to free, which took a seventh of the compilation time.
    """
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


KERNEL_OPTIONS = dict(OPTIONS)  # of a kernel that Python calls
INNER_OPTIONS = OPTIONS | ({"no_cpython_wrapper": True} if _is_lean else {})  # of one that only kernels call
NOT_INLINED_OPTIONS = dict(INNER_OPTIONS)  # the same, but it remains a function


if _is_hooked:
    from numba.core.compiler import Compiler

    class KernelCompiler(Compiler):  # type: ignore[misc]
        """Numba's compiler with remembered choices and without garbage collection."""

        def _compile_core(self) -> Any:
            with choices_remembered(), collection_paused():
                return super()._compile_core()  # type: ignore[no-untyped-call]

    for _options in (KERNEL_OPTIONS, INNER_OPTIONS, NOT_INLINED_OPTIONS):
        _options["pipeline_class"] = KernelCompiler

if _is_hooked and has(CALLEES):
    from numba.core.codegen import JITCodeLibrary

    class CalleeLibrary(JITCodeLibrary):  # type: ignore[misc]
        """The code of a kernel and its callees, for callers to link: neither optimised as a whole nor machine code."""

        def finalize(self) -> None:
            """Link the callees."""
            self._raise_if_finalized()  # type: ignore[no-untyped-call]
            for library in dict.fromkeys(self._linking_libraries):
                self._reload_init.update(library._reload_init)
                self._final_module.link_in(library._get_module_for_linking(), preserve=True)
            self._finalize_dynamic_globals()  # type: ignore[no-untyped-call]
            self._finalized = True

    class CalleeCompiler(KernelCompiler):
        """The same, but only up to the code that callers link."""

        def _compile_core(self) -> Any:
            state, name = self.state, self.state.func_id.func_qualname
            state.flags.no_compile = True
            state.library = CalleeLibrary(state.targetctx.codegen(), name)  # type: ignore[no-untyped-call]
            # Numba identifies functions by their entry points for Python. There is none here, so a built-in method
            # stands in
            result = super()._compile_core()._replace(entry_point=[name].append)
            result.target_context.insert_user_function(result.entry_point, result.fndesc, [result.library])
            return result

    class NotInlinedCompiler(CalleeCompiler):
        """The same, for a function that is not inlined into its callers."""

        def _compile_core(self) -> Any:
            result = super()._compile_core()
            code = result.library._final_module.get_function(result.fndesc.mangled_name)
            code.add_function_attribute("noinline")
            return result

    INNER_OPTIONS["pipeline_class"], NOT_INLINED_OPTIONS["pipeline_class"] = CalleeCompiler, NotInlinedCompiler


# -- eight numbers at a time -----------------------------------------------------------------------------------------


def data_of(context: Any, builder: Any, kind: Any, array: Any) -> Any:
    """Return the address of an array's first number in generated code."""
    return context.make_array(kind)(context, builder, array).data


def converted(context: Any, builder: Any, value: Any, given: Any, wanted: Any) -> Any:
    """Return a value of one Numba type as a value of another in generated code."""
    return context.cast(builder, value, given, wanted)


def nothing(context: Any) -> Any:
    """Return what a function without a result returns in generated code."""
    return context.get_dummy_value()


def declared(builder: Any, name: str, kind: Any) -> Any:
    """Return a function of LLVM, declared in the module that is generated."""
    return cgutils.get_or_insert_function(builder.module, kind, name)  # type: ignore[no-untyped-call]


# -- tuples of arrays by address -------------------------------------------------------------------------------------
#
# Numba passes a tuple of arrays by value: at least seven numbers per array, which are unpacked and packed again at each
# call. The 150 arrays of a run made up most of the code of all kernels in this way. A tuple declared here is a single
# address: that of a table of array descriptions, which is filled once, when Python calls the kernel.

WORD = 8  # bytes
BYTE, ADDRESS = ir.IntType(8), ir.IntType(8).as_pointer()
INDEX_TYPE = ir.IntType(64)
# Numba's description of an array: two words for its owner, the number of items, the size of an item in bytes, their
# address; shape and strides have one word per axis
ITEMS, ITEM_SIZE, DATA, SHAPE, STRIDES = 2, 3, 4, 5, 6


class TupleByAddress(types.Type):
    """The Numba type of a declared tuple."""

    def __init__(self, name: str, fields: dict[str, Any]) -> None:
        digest = hashlib.sha256(repr(list(fields.items())).encode()).hexdigest()[:16]
        super().__init__(name=f"{name}_{digest}")  # part of the name of each kernel that takes such a tuple
        self.fields = fields
        self.first: dict[str, int] = {}  # the first word of each field in the table
        self.words = 0
        for field, kind in fields.items():
            self.first[field] = self.words
            self.words += _words(kind)


def _words(kind: Any) -> int:
    """Return the number of words of the table that a field takes."""
    if isinstance(kind, TupleByAddress):
        return kind.words
    return SHAPE + 2 * kind.ndim if isinstance(kind, types.Array) else 1


def by_address(named_tuple: T) -> T:
    """Make kernels pass on named tuples of this class by address; a class decorator.

    The fields may be arrays, floats, integers, truth values and other tuples declared in this way. In kernels only the
    fields of such a tuple can be accessed: it is neither created nor unpacked there. Without compilation
    (NUMBA_DISABLE_JIT) it is the plain Python tuple.
    """
    if not _passes_addresses:
        return named_tuple

    @typeof_impl.register(named_tuple)
    def _typeof(value: Any, context: Any) -> TupleByAddress:
        kinds = (typeof_impl(field, context) for field in value)
        return TupleByAddress(named_tuple.__name__, dict(zip(value._fields, kinds, strict=True)))

    return named_tuple


def _describes_arrays_as_here() -> bool:
    """Return whether the words of an array's description are in the order that is assumed here."""
    array = _find("context:data_model_manager")[types.Array(types.float64, 2, "C")]
    order = ("nitems", ITEMS), ("itemsize", ITEM_SIZE), ("data", DATA), ("shape", SHAPE), ("strides", STRIDES)
    try:
        right = all(array.get_field_position(name) == place for name, place in order)
    except (LookupError, ValueError):
        right = False
    if not right:
        lost(TUPLES, ":array with its parts in the order of before")
    return right


# the table is filled by a function of Numba for kernels that count no references
_passes_addresses = _is_lean and has(TUPLES) and _describes_arrays_as_here()


@register_model(TupleByAddress)
class TupleByAddressModel(models.PrimitiveModel):  # type: ignore[misc]
    """The address of the table."""

    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ADDRESS)  # type: ignore[no-untyped-call]


def _lower_field(context: Any, builder: Any, kind: Any, address: Any, name: str) -> Any:
    field, first = kind.fields[name], kind.first[name]
    if isinstance(field, TupleByAddress):
        return _at(builder, address, first)
    if isinstance(field, types.Array):
        return _read_array(context, builder, field, address, first)
    number = _read(builder, address, first, context.get_data_type(field))
    return context.data_model_manager[field].from_data(builder, number)


def _at(builder: Any, address: Any, word: int) -> Any:
    """Return the address of a word of the table."""
    return builder.gep(address, [INDEX_TYPE(WORD * word)], source_etype=BYTE) if word else address


def _read(builder: Any, address: Any, word: int, kind: Any) -> Any:
    """Return a word of the table as a value of an LLVM type."""
    # not marked as invariant, because LLVM would read the table before it is filled where a kernel is inlined
    return builder.load(builder.bitcast(_at(builder, address, word), kind.as_pointer()), align=WORD)


def _read_array(context: Any, builder: Any, kind: Any, address: Any, first: int) -> Any:
    """Return Numba's description of an array; values known from its type are not read."""
    array = context.get_value_type(kind)
    item_size = context.get_abi_sizeof(context.get_data_type(kind.dtype))
    known = [ir.Constant(element, item_size if place == ITEM_SIZE else None) for place, element in enumerate(array)]
    value = ir.Constant(array, known)
    value = builder.insert_value(value, _read(builder, address, first + ITEMS, INDEX_TYPE), ITEMS)
    value = builder.insert_value(value, _read(builder, address, first + DATA, array.elements[DATA]), DATA)
    for axis in range(kind.ndim):
        length, stride = first + SHAPE + axis, first + SHAPE + kind.ndim + axis
        value = builder.insert_value(value, _read(builder, address, length, INDEX_TYPE), [SHAPE, axis])
        packed = kind.layout == "C" and axis == kind.ndim - 1
        distance = INDEX_TYPE(item_size) if packed else _read(builder, address, stride, INDEX_TYPE)
        value = builder.insert_value(value, distance, [STRIDES, axis])
    return value


@unbox(TupleByAddress)  # type: ignore[no-untyped-call]
def _unbox(kind: Any, given: Any, c: Any) -> NativeValue:
    """Fill the table of a tuple that Python passes to a kernel."""
    room = cgutils.alloca_once(c.builder, INDEX_TYPE, size=kind.words)  # type: ignore[no-untyped-call]
    table = c.builder.bitcast(room, ADDRESS)
    failed = _fill(kind, given, table, c)
    return NativeValue(table, is_error=failed)  # type: ignore[no-untyped-call]


def _fill(kind: Any, given: Any, table: Any, c: Any) -> Any:
    """Write the words of a tuple; return the generated flag for failure, in which case a Python exception is set."""
    failed = cgutils.false_bit
    for number, (name, field) in enumerate(kind.fields.items()):
        item, place = c.pyapi.tuple_getitem(given, number), _at(c.builder, table, kind.first[name])
        if isinstance(field, TupleByAddress):
            failed = c.builder.or_(failed, _fill(field, item, place, c))
        elif isinstance(field, types.Array):
            c.pyapi.numba_array_adaptor(item, place)  # cannot fail: the type was taken from this very array
        else:
            native = c.unbox(field, item)
            data = c.context.data_model_manager[field].as_data(c.builder, native.value)
            c.builder.store(data, c.builder.bitcast(place, data.type.as_pointer()))
            failed = c.builder.or_(failed, native.is_error)
    return failed


if _passes_addresses:
    from numba.core.typing.templates import AttributeTemplate
    from numba.extending import infer_getattr, lower_getattr_generic

    @infer_getattr
    class TupleByAddressFields(AttributeTemplate):  # type: ignore[misc]
        """The types of the fields."""

        key = TupleByAddress

        def generic_resolve(self, kind: Any, name: str) -> Any:  # type: ignore[override]
            """Return the type of a field; None if there is no field of that name."""
            return kind.fields.get(name)

    lower_getattr_generic(TupleByAddress)(_lower_field)  # type: ignore[no-untyped-call]
