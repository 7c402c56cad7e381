"""C code that computes eight samples of a function at once, with vectors of numbers in place of numbers.

Each operation is the one that a sample alone would get, so results are equal to the last bit. Processors
without wide vectors take several instructions for one.
"""

import casadi as ca

WIDTH = 8  # samples that are computed at once
_UNARY = {
    ca.OP_ASSIGN: "{0}",
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "{0} + {0}",
    ca.OP_INV: "1.0 / {0}",
    ca.OP_SIN: "lanes_sin({0})",
    ca.OP_COS: "lanes_cos({0})",
    ca.OP_SQRT: "lanes_sqrt({0})",
}
_BINARY = {ca.OP_ADD: "+", ca.OP_SUB: "-", ca.OP_MUL: "*", ca.OP_DIV: "/"}
HEAD = f"""
#include <math.h>
typedef double lanes __attribute__((vector_size({8 * WIDTH})));
#define LANES_OF(name) \\
  static inline __attribute__((always_inline)) void lanes_##name##_at(lanes *y, const lanes *x) {{ \\
    for (int i = 0; i < {WIDTH}; ++i) (*y)[i] = name((*x)[i]); \\
  }}
LANES_OF(sin)
LANES_OF(cos)
LANES_OF(sqrt)
#define lanes_sin(x) ({{lanes given = x, made; lanes_sin_at(&made, &given); made;}})
#define lanes_cos(x) ({{lanes given = x, made; lanes_cos_at(&made, &given); made;}})
#define lanes_sqrt(x) ({{lanes given = x, made; lanes_sqrt_at(&made, &given); made;}})
"""
_LOOP = """
void map_{name}(const double** in, double** out, long long samples) {{
  for (long long first = 0; first < samples; first += {width}) {{
    long long at[{width}];
    for (int i = 0; i < {width}; ++i) at[i] = first + i < samples ? first + i : samples - 1;
    lanes w[{work}];
{body}  }}
}}
"""


def lane_loop(function: ca.Function) -> str:
    """C source of the loop `map_NAME` over the samples of a function of scalars (SX).

    Raises:
        ValueError: if the function has an operation that is not known here.
    """
    lines = "".join(f"    {_statement(function, k)}\n" for k in range(function.n_instructions()))
    return _LOOP.format(name=function.name(), width=WIDTH, work=function.sz_w(), body=lines)


def _statement(f: ca.Function, k: int) -> str:
    """C statement of an instruction."""
    code, given, made = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
    if code == ca.OP_INPUT:
        size = f.numel_in(given[0])
        values = ", ".join(f"in[{given[0]}][{size} * at[{i}] + {given[1]}]" for i in range(WIDTH))
        return f"w[{made[0]}] = (lanes){{{values}}};"
    if code == ca.OP_OUTPUT:
        size = f.numel_out(made[0])
        place = f"out[{made[0]}][{size} * at[i] + {made[1]}]"
        return f"for (int i = 0; i < {WIDTH}; ++i) {place} = w[{given[0]}][i];"
    if code == ca.OP_CONST:
        return f"w[{made[0]}] = {f.instruction_constant(k)!r} - (lanes){{0.0}};"
    operands = [f"w[{i}]" for i in given]
    if code in _BINARY:
        return f"w[{made[0]}] = {operands[0]} {_BINARY[code]} {operands[1]};"
    if code in _UNARY:
        return f"w[{made[0]}] = {_UNARY[code].format(operands[0])};"
    raise ValueError(f"{f.name()} has an operation without a vector of samples: {f.instructions_sx()[k]}")
