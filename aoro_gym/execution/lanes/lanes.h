// Types and functions of Warp's generated C++ whose numbers are several lanes wide: what a kernel says of one thread is
// done for LANES threads at once. Written for GCC's and Clang's vector extensions; translate.py says what it is for.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#if defined(__x86_64__)
#include <immintrin.h>
#endif

#ifndef LANES
#if defined(__AVX512F__)
#define LANES 16
#elif defined(__AVX__)
#define LANES 8
#else
#define LANES 4
#endif
#endif

#if defined(__x86_64__) && defined(__GLIBC__) && LANES == 16 && defined(__AVX512F__)
#define VECTOR_MATH(name) _ZGVeN16v_##name
#define VECTOR_MATH_2(name) _ZGVeN16vv_##name
#elif defined(__x86_64__) && defined(__GLIBC__) && LANES == 8 && defined(__AVX2__)
#define VECTOR_MATH(name) _ZGVdN8v_##name
#define VECTOR_MATH_2(name) _ZGVdN8vv_##name
#elif defined(__x86_64__) && defined(__GLIBC__) && LANES == 4
#define VECTOR_MATH(name) _ZGVbN4v_##name
#define VECTOR_MATH_2(name) _ZGVbN4vv_##name
#endif

#define INLINE inline __attribute__((always_inline))

namespace wp {

typedef float floats __attribute__((vector_size(4 * LANES)));
typedef int ints __attribute__((vector_size(4 * LANES)));

// ---- numbers and truths

struct mask {
    ints v;  // -1 where true
    mask() = default;
    INLINE mask(bool all) : v(ints{} - int(all)) {}
    INLINE explicit mask(ints v) : v(v) {}
};

INLINE mask operator&&(mask a, mask b) { return mask(a.v & b.v); }
INLINE mask operator||(mask a, mask b) { return mask(a.v | b.v); }
INLINE mask operator!(mask a) { return mask(~a.v); }
INLINE mask operator==(mask a, mask b) { return mask(~(a.v ^ b.v)); }
INLINE mask operator!=(mask a, mask b) { return mask(a.v ^ b.v); }
INLINE mask unot(mask a) { return !a; }

INLINE bool any(mask a)
{
#if LANES == 16 && defined(__AVX512F__)
    return _mm512_test_epi32_mask((__m512i)a.v, (__m512i)a.v) != 0;
#elif LANES == 8 && defined(__AVX__)
    return !_mm256_testz_si256((__m256i)a.v, (__m256i)a.v);
#else
    int found = 0;
    for (int i = 0; i < LANES; ++i)
        found |= a.v[i];
    return found != 0;
#endif
}
INLINE bool all(mask a) { return !any(!a); }

struct int32 {
    ints v;
    int32() = default;
    INLINE int32(int x) : v(ints{} + x) {}
    INLINE explicit int32(ints v) : v(v) {}
};

struct float32 {
    floats v;
    float32() = default;
    INLINE float32(float x) : v(floats{} + x) {}
    INLINE float32(double x) : float32(float(x)) {}
    INLINE float32(int x) : float32(float(x)) {}
    INLINE explicit float32(floats v) : v(v) {}
};

#define OPERATOR(type, sign) INLINE type operator sign(type a, type b) { return type(a.v sign b.v); }
#define COMPARISON(type, sign) INLINE mask operator sign(type a, type b) { return mask(ints(a.v sign b.v)); }
#define BOTH(macro) macro(float32, +) macro(float32, -) macro(float32, *) macro(int32, +) macro(int32, -) macro(int32, *)
BOTH(OPERATOR)
OPERATOR(float32, /)
#define COMPARE(type) \
    COMPARISON(type, <) COMPARISON(type, >) COMPARISON(type, <=) COMPARISON(type, >=) COMPARISON(type, ==) COMPARISON(type, !=)
COMPARE(float32)
COMPARE(int32)
#undef OPERATOR
#undef COMPARISON
#undef COMPARE
#undef BOTH

INLINE float32 where(mask m, float32 a, float32 b) { return float32(m.v ? a.v : b.v); }
INLINE int32 where(mask m, int32 a, int32 b) { return int32(m.v ? a.v : b.v); }
INLINE mask where(mask m, mask a, mask b) { return mask((m.v & a.v) | (~m.v & b.v)); }

INLINE float32 to_float(int32 a) { return float32(__builtin_convertvector(a.v, floats)); }
INLINE float32 to_float(float32 a) { return a; }
INLINE int32 to_int(float32 a) { return int32(__builtin_convertvector(a.v, ints)); }
INLINE int32 to_int(int32 a) { return a; }
INLINE int32 to_int(int a) { return int32(a); }
INLINE float32 to_float(int a) { return float32(float(a)); }

template <class T> INLINE T add(T a, T b) { return a + b; }
template <class T> INLINE T sub(T a, T b) { return a - b; }
INLINE float32 mul(float32 a, float32 b) { return a * b; }
INLINE int32 mul(int32 a, int32 b) { return a * b; }
INLINE float32 div(float32 a, float32 b) { return a / b; }
INLINE float32 neg(float32 a) { return float32(-a.v); }
INLINE int32 neg(int32 a) { return int32(-a.v); }
INLINE int add(int a, int b) { return a + b; }
INLINE int sub(int a, int b) { return a - b; }
INLINE int mul(int a, int b) { return a * b; }
INLINE int32 add(int32 a, int b) { return a + int32(b); }
INLINE int32 add(int a, int32 b) { return int32(a) + b; }
INLINE int32 sub(int32 a, int b) { return a - int32(b); }
INLINE int32 sub(int a, int32 b) { return int32(a) - b; }
INLINE int32 mul(int32 a, int b) { return a * int32(b); }
INLINE int32 mul(int a, int32 b) { return int32(a) * b; }

// of whole numbers each lane by itself: processors divide no vectors of them
template <class F> INLINE int32 lanewise(int32 a, int32 b, F of)
{
    int32 out;
    for (int i = 0; i < LANES; ++i)
        out.v[i] = b.v[i] == 0 ? 0 : of(a.v[i], b.v[i]);
    return out;
}
INLINE int32 mod(int32 a, int32 b) { return lanewise(a, b, [](int x, int y) { return x % y; }); }
INLINE int32 floordiv(int32 a, int32 b)
{
    return lanewise(a, b, [](int x, int y) { return x / y - ((x % y != 0) && ((x < 0) != (y < 0))); });
}
INLINE int32 bit_and(int32 a, int32 b) { return int32(a.v & b.v); }
INLINE int32 bit_or(int32 a, int32 b) { return int32(a.v | b.v); }
INLINE int32 rshift(int32 a, int32 b) { return int32(a.v >> b.v); }
INLINE int32 lshift(int32 a, int32 b) { return int32(a.v << b.v); }

INLINE float32 min(float32 a, float32 b) { return where(a < b, a, b); }
INLINE float32 max(float32 a, float32 b) { return where(a > b, a, b); }
INLINE int32 min(int32 a, int32 b) { return where(a < b, a, b); }
INLINE int32 max(int32 a, int32 b) { return where(a > b, a, b); }
INLINE float32 clamp(float32 x, float32 a, float32 b) { return min(max(a, x), b); }
INLINE int32 clamp(int32 x, int32 a, int32 b) { return min(max(a, x), b); }
INLINE float32 abs(float32 a) { return float32(floats(ints(a.v) & 0x7fffffff)); }
INLINE int32 abs(int32 a) { return max(a, neg(a)); }
INLINE float32 sign(float32 a) { return where(a < float32(0.0f), float32(-1.0f), float32(1.0f)); }
INLINE mask isfinite(float32 a) { return mask(ints((ints(a.v) & 0x7f800000) != 0x7f800000)); }
INLINE mask isnan(float32 a) { return a != a; }

template <class F> INLINE float32 lanewise(float32 a, F of)
{
    float32 out;
    for (int i = 0; i < LANES; ++i)
        out.v[i] = of(float(a.v[i]));
    return out;
}
#if LANES == 16 && defined(__AVX512F__)
INLINE float32 sqrt(float32 a) { return float32((floats)_mm512_sqrt_ps((__m512)a.v)); }
INLINE float32 floor(float32 a) { return float32((floats)_mm512_roundscale_ps((__m512)a.v, 0x09)); }
INLINE float32 ceil(float32 a) { return float32((floats)_mm512_roundscale_ps((__m512)a.v, 0x0a)); }
#elif LANES == 8 && defined(__AVX__)
INLINE float32 sqrt(float32 a) { return float32((floats)_mm256_sqrt_ps((__m256)a.v)); }
INLINE float32 floor(float32 a) { return float32((floats)_mm256_floor_ps((__m256)a.v)); }
INLINE float32 ceil(float32 a) { return float32((floats)_mm256_ceil_ps((__m256)a.v)); }
#else
INLINE float32 sqrt(float32 a) { return lanewise(a, [](float x) { return __builtin_sqrtf(x); }); }
INLINE float32 floor(float32 a) { return lanewise(a, [](float x) { return __builtin_floorf(x); }); }
INLINE float32 ceil(float32 a) { return lanewise(a, [](float x) { return __builtin_ceilf(x); }); }
#endif

#ifdef VECTOR_MATH  // glibc's vector library, within 4 units in the last place
#define FUNCTION(name) \
    extern "C" floats VECTOR_MATH(name##f)(floats); \
    INLINE float32 name(float32 a) { return float32(VECTOR_MATH(name##f)(a.v)); }
#define FUNCTION_2(name) \
    extern "C" floats VECTOR_MATH_2(name##f)(floats, floats); \
    INLINE float32 name(float32 a, float32 b) { return float32(VECTOR_MATH_2(name##f)(a.v, b.v)); }
#else
#define FUNCTION(name) INLINE float32 name(float32 a) { return lanewise(a, [](float x) { return ::name##f(x); }); }
#define FUNCTION_2(name) \
    INLINE float32 name(float32 a, float32 b) \
    { \
        float32 out; \
        for (int i = 0; i < LANES; ++i) \
            out.v[i] = ::name##f(a.v[i], b.v[i]); \
        return out; \
    }
#endif
FUNCTION(sin)
FUNCTION(cos)
FUNCTION(tan)
FUNCTION(exp)
FUNCTION(log)
FUNCTION(tanh)
FUNCTION(asin)
FUNCTION(acos)
FUNCTION(atan)
FUNCTION_2(pow)
FUNCTION_2(atan2)
#undef FUNCTION
#undef FUNCTION_2

struct uint64 {  // the same for all lanes
    uint64_t v;
};
INLINE uint64 where(mask, uint64 a, uint64) { return a; }

// ---- vectors, matrices, quaternions

struct unset {};  // parts that are assigned before they are read

template <int N, class T> struct vec_t {
    T c[N];
    INLINE explicit vec_t(unset) {}
    INLINE vec_t() : c{} {}
    INLINE explicit vec_t(T all)
    {
        for (int i = 0; i < N; ++i)
            c[i] = all;
    }
    template <class... Parts> INLINE vec_t(T x, T y, Parts... rest) : c{x, y, T(rest)...} {}
    INLINE T& operator[](int i) { return c[i]; }
    INLINE const T& operator[](int i) const { return c[i]; }
};
template <int R, int C, class T> struct mat_t {
    T data[R][C];
    INLINE explicit mat_t(unset) {}
    INLINE mat_t() : data{} {}
    template <class... Parts> INLINE mat_t(T x, T y, Parts... rest)
    {
        const T parts[] = {x, y, T(rest)...};
        for (int i = 0; i < R * C; ++i)
            data[i / C][i % C] = parts[i];
    }
};
template <class T> struct quat_t {
    T x, y, z, w;
    INLINE quat_t() : x(), y(), z(), w() {}
    INLINE quat_t(T x, T y, T z, T w) : x(x), y(y), z(z), w(w) {}
};
template <int N, class T> struct initializer_array {
    T c[N];
    INLINE operator vec_t<N, T>() const
    {
        vec_t<N, T> out;
        for (int i = 0; i < N; ++i)
            out.c[i] = c[i];
        return out;
    }
};

#define EACH(i, n) for (int i = 0; i < n; ++i)
#define VECTOR template <int N, class T> INLINE vec_t<N, T>
VECTOR operator+(const vec_t<N, T>& a, const vec_t<N, T>& b)
{
    vec_t<N, T> out{unset()};
    EACH(i, N) out.c[i] = a.c[i] + b.c[i];
    return out;
}
VECTOR operator-(const vec_t<N, T>& a, const vec_t<N, T>& b)
{
    vec_t<N, T> out{unset()};
    EACH(i, N) out.c[i] = a.c[i] - b.c[i];
    return out;
}
VECTOR mul(const vec_t<N, T>& a, T b)
{
    vec_t<N, T> out{unset()};
    EACH(i, N) out.c[i] = a.c[i] * b;
    return out;
}
VECTOR mul(T a, const vec_t<N, T>& b) { return mul(b, a); }
VECTOR div(const vec_t<N, T>& a, T b)
{
    vec_t<N, T> out{unset()};
    EACH(i, N) out.c[i] = a.c[i] / b;
    return out;
}
VECTOR cw_mul(const vec_t<N, T>& a, const vec_t<N, T>& b)
{
    vec_t<N, T> out{unset()};
    EACH(i, N) out.c[i] = a.c[i] * b.c[i];
    return out;
}
VECTOR neg(const vec_t<N, T>& a) { return vec_t<N, T>() - a; }
VECTOR where(mask m, const vec_t<N, T>& a, const vec_t<N, T>& b)
{
    vec_t<N, T> out{unset()};
    EACH(i, N) out.c[i] = where(m, a.c[i], b.c[i]);
    return out;
}
template <int N, class T> INLINE T dot(const vec_t<N, T>& a, const vec_t<N, T>& b)
{
    T out = a.c[0] * b.c[0];
    for (int i = 1; i < N; ++i)
        out = out + a.c[i] * b.c[i];
    return out;
}
template <int N, class T> INLINE T length(const vec_t<N, T>& a) { return sqrt(dot(a, a)); }
VECTOR normalize(const vec_t<N, T>& a)
{
    const T size = length(a);
    return where(size > T(0.0f), div(a, size), vec_t<N, T>());
}
template <class T> INLINE vec_t<3, T> cross(const vec_t<3, T>& a, const vec_t<3, T>& b)
{
    return vec_t<3, T>(
        a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    );
}
#define MATRIX template <int R, int C, class T> INLINE mat_t<R, C, T>
MATRIX operator+(const mat_t<R, C, T>& a, const mat_t<R, C, T>& b)
{
    mat_t<R, C, T> out{unset()};
    EACH(i, R) EACH(j, C) out.data[i][j] = a.data[i][j] + b.data[i][j];
    return out;
}
MATRIX operator-(const mat_t<R, C, T>& a, const mat_t<R, C, T>& b)
{
    mat_t<R, C, T> out{unset()};
    EACH(i, R) EACH(j, C) out.data[i][j] = a.data[i][j] - b.data[i][j];
    return out;
}
MATRIX mul(const mat_t<R, C, T>& a, T b)
{
    mat_t<R, C, T> out{unset()};
    EACH(i, R) EACH(j, C) out.data[i][j] = a.data[i][j] * b;
    return out;
}
MATRIX mul(T a, const mat_t<R, C, T>& b) { return mul(b, a); }
MATRIX div(const mat_t<R, C, T>& a, T b)
{
    mat_t<R, C, T> out{unset()};
    EACH(i, R) EACH(j, C) out.data[i][j] = a.data[i][j] / b;
    return out;
}
MATRIX neg(const mat_t<R, C, T>& a) { return mat_t<R, C, T>() - a; }
MATRIX where(mask m, const mat_t<R, C, T>& a, const mat_t<R, C, T>& b)
{
    mat_t<R, C, T> out{unset()};
    EACH(i, R) EACH(j, C) out.data[i][j] = where(m, a.data[i][j], b.data[i][j]);
    return out;
}
template <int R, int K, int C, class T> INLINE mat_t<R, C, T> mul(const mat_t<R, K, T>& a, const mat_t<K, C, T>& b)
{
    mat_t<R, C, T> out{unset()};
    EACH(i, R) EACH(j, C)
    {
        T sum = a.data[i][0] * b.data[0][j];
        for (int k = 1; k < K; ++k)
            sum = sum + a.data[i][k] * b.data[k][j];
        out.data[i][j] = sum;
    }
    return out;
}
template <int R, int C, class T> INLINE vec_t<R, T> mul(const mat_t<R, C, T>& a, const vec_t<C, T>& b)
{
    vec_t<R, T> out{unset()};
    EACH(i, R)
    {
        T sum = a.data[i][0] * b.c[0];
        for (int k = 1; k < C; ++k)
            sum = sum + a.data[i][k] * b.c[k];
        out.c[i] = sum;
    }
    return out;
}
template <int R, int C, class T> INLINE mat_t<C, R, T> transpose(const mat_t<R, C, T>& a)
{
    mat_t<C, R, T> out{unset()};
    EACH(i, R) EACH(j, C) out.data[j][i] = a.data[i][j];
    return out;
}
template <int R, int C, class T> INLINE mat_t<R, C, T> outer(const vec_t<R, T>& a, const vec_t<C, T>& b)
{
    mat_t<R, C, T> out{unset()};
    EACH(i, R) EACH(j, C) out.data[i][j] = a.c[i] * b.c[j];
    return out;
}
template <int N, class T> INLINE mat_t<N, N, T> diag(const vec_t<N, T>& a)
{
    mat_t<N, N, T> out;
    EACH(i, N) out.data[i][i] = a.c[i];
    return out;
}
template <class T> INLINE mat_t<3, 3, T> skew(const vec_t<3, T>& a)
{
    const T zero(0.0f);
    return mat_t<3, 3, T>(zero, neg(a[2]), a[1], a[2], zero, neg(a[0]), neg(a[1]), a[0], zero);
}
template <class T> INLINE mat_t<3, 3, T> inverse(const mat_t<3, 3, T>& m)
{
    const vec_t<3, T> a(m.data[0][0], m.data[0][1], m.data[0][2]);
    const vec_t<3, T> b(m.data[1][0], m.data[1][1], m.data[1][2]);
    const vec_t<3, T> c(m.data[2][0], m.data[2][1], m.data[2][2]);
    const vec_t<3, T> x = cross(b, c), y = cross(c, a), z = cross(a, b);
    const T determinant = dot(a, x);
    const T scale = where(determinant != T(0.0f), T(1.0f) / determinant, T(0.0f));
    return mul(mat_t<3, 3, T>(x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]), scale);
}
template <class T> INLINE quat_t<T> where(mask m, const quat_t<T>& a, const quat_t<T>& b)
{
    return quat_t<T>(where(m, a.x, b.x), where(m, a.y, b.y), where(m, a.z, b.z), where(m, a.w, b.w));
}
template <class T> INLINE quat_t<T> operator+(const quat_t<T>& a, const quat_t<T>& b)
{
    return quat_t<T>(a.x + b.x, a.y + b.y, a.z + b.z, a.w + b.w);
}
template <class T> INLINE quat_t<T> mul(const quat_t<T>& a, T b) { return quat_t<T>(a.x * b, a.y * b, a.z * b, a.w * b); }
template <class T> INLINE quat_t<T> mul(T a, const quat_t<T>& b) { return mul(b, a); }
template <class T> INLINE quat_t<T> mul(const quat_t<T>& a, const quat_t<T>& b)
{
    return quat_t<T>(
        a.w * b.x + b.w * a.x + a.y * b.z - b.y * a.z, a.w * b.y + b.w * a.y + a.z * b.x - b.z * a.x,
        a.w * b.z + b.w * a.z + a.x * b.y - b.x * a.y, a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z
    );
}
template <class T> INLINE quat_t<T> normalize(const quat_t<T>& q)
{
    const T size = sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w);
    const T zero(0.0f), one(1.0f);
    return where(size > zero, mul(q, one / size), quat_t<T>(zero, zero, zero, one));
}
template <class T> INLINE quat_t<T> quat_from_axis_angle(const vec_t<3, T>& axis, T angle)
{
    const T half = angle * T(0.5f), s = sin(half);
    return quat_t<T>(axis[0] * s, axis[1] * s, axis[2] * s, cos(half));
}
template <class T> INLINE vec_t<3, T> quat_rotate(const quat_t<T>& q, const vec_t<3, T>& a)
{
    const vec_t<3, T> axis(q.x, q.y, q.z);
    const T two(2.0f);
    return mul(a, two * q.w * q.w - T(1.0f)) + mul(mul(axis, dot(axis, a)), two) + mul(mul(cross(axis, a), q.w), two);
}
template <class T> INLINE mat_t<3, 3, T> quat_to_matrix(const quat_t<T>& q)
{
    const T one(1.0f), two(2.0f);
    const T xx = two * q.x * q.x, yy = two * q.y * q.y, zz = two * q.z * q.z, ww = two * q.w * q.w;
    const T xy = two * q.x * q.y, xz = two * q.x * q.z, yz = two * q.y * q.z;
    const T xw = two * q.x * q.w, yw = two * q.y * q.w, zw = two * q.z * q.w;
    return mat_t<3, 3, T>(
        ww + xx - one, xy - zw, xz + yw, xy + zw, ww + yy - one, yz - xw, xz - yw, yz + xw, ww + zz - one
    );
}
#undef VECTOR
#undef MATRIX

// ---- parts of them: an index is the same for all lanes

INLINE int same(int i) { return i; }
INLINE int same(int32 i) { return i.v[0]; }
template <int N, class T, class I> INLINE T extract(const vec_t<N, T>& a, I i) { return a.c[same(i)]; }
template <int R, int C, class T, class I, class J> INLINE T extract(const mat_t<R, C, T>& a, I i, J j)
{
    return a.data[same(i)][same(j)];
}
template <class T, class I> INLINE T extract(const quat_t<T>& q, I i)
{
    const T parts[] = {q.x, q.y, q.z, q.w};
    return parts[same(i)];
}
template <int N, class T, class I> INLINE T* indexref(vec_t<N, T>* a, I i) { return &a->c[same(i)]; }

template <class T> INLINE const T& copy(const T& a) { return a; }
template <class T> INLINE const T& load(const T* a) { return *a; }
template <class T> INLINE void assign(T& a, const T& b) { a = b; }
template <class T> INLINE void assign(mask m, T& a, const T& b) { a = where(m, b, a); }
template <class T> INLINE void store(T* a, const T& b) { *a = b; }
template <class T> INLINE void store(mask m, T* a, const T& b) { *a = where(m, b, *a); }
template <int N, class T, class I> INLINE void assign_inplace(vec_t<N, T>& a, I i, const T& b) { a.c[same(i)] = b; }
template <int N, class T, class I> INLINE void assign_inplace(mask m, vec_t<N, T>& a, I i, const T& b)
{
    a.c[same(i)] = where(m, b, a.c[same(i)]);
}

// ---- loops, which all lanes run alike

struct range_t {
    int next, end, step;
};
template <class I> INLINE range_t range(I end) { return range_t{0, same(end), 1}; }
template <class I, class J> INLINE range_t range(I begin, J end) { return range_t{same(begin), same(end), 1}; }
INLINE int iter_cmp(const range_t& r) { return r.step > 0 ? r.next < r.end : r.next > r.end; }
INLINE int32 iter_next(range_t& r)
{
    const int now = r.next;
    r.next += r.step;
    return int32(now);
}

// ---- memory: arrays of numbers as they lie there, of which lanes take each their own

struct shape_t {
    int dims[4];
};
template <class I> INLINE int32 extract(const shape_t& shape, I i) { return int32(shape.dims[same(i)]); }

template <class T> struct array_t {  // laid out as Warp's
    char* data;
    char* grad;
    shape_t shape;
    int strides[4];
    uint16_t ndim, flags;
};
template <int N> struct launch_bounds_t {
    uint32_t shape[N];
    size_t size, coord_mult;
};

static thread_local mask active;  // lanes that are threads, and have not returned

INLINE int32 counted()
{
    int32 out;
    for (int i = 0; i < LANES; ++i)
        out.v[i] = i;
    return out;
}
// Numbers of the threads from ``task`` on; lanes beyond the last one repeat it, and are not active.
INLINE int32 lanes_from(size_t task, size_t size)
{
    const int32 number = counted() + int32(int(task)), last(int(size) - 1);
    active = number <= last;
    return min(number, last);
}

template <class T> struct ref {  // where the lanes' elements lie: a place, and bytes from there
    char* at;
    int32 away;
    bool in_a_row;
};
INLINE int32 within(int32 i, int size) { return clamp(i, int32(0), int32(size > 0 ? size - 1 : 0)); }
INLINE bool equal(int32 i) { return all(i == int32(i.v[0])); }

template <class T> INLINE ref<T> address(const array_t<T>& a, int32 i)
{
    i = within(i, a.shape.dims[0]);
    const int first = i.v[0];
    const int32 from = i - int32(first);
    const bool row = all(from == counted()) && a.strides[0] == 4;
    return ref<T>{a.data + ptrdiff_t(first) * a.strides[0], from * int32(a.strides[0]), row};
}
template <class T> INLINE ref<T> address(const array_t<T>& a, int32 i, int32 j)
{
    i = within(i, a.shape.dims[0]);
    const int first = i.v[0];
    array_t<T> row = a;
    row.data = a.data + ptrdiff_t(first) * a.strides[0];
    row.shape.dims[0] = a.shape.dims[1];
    row.strides[0] = a.strides[1];
    ref<T> found = address(row, j);
    if (!equal(i)) {
        found.away = found.away + (i - int32(first)) * int32(a.strides[0]);
        found.in_a_row = false;
    }
    return found;
}
template <class T> INLINE array_t<T> view(const array_t<T>& a, int32 i)
{
    array_t<T> out = a;
    out.data = a.data + ptrdiff_t(within(i, a.shape.dims[0]).v[0]) * a.strides[0];
    for (int k = 0; k < 3; ++k) {
        out.shape.dims[k] = a.shape.dims[k + 1];
        out.strides[k] = a.strides[k + 1];
    }
    out.ndim = a.ndim - 1;
    return out;
}
template <class T> INLINE ref<T> address(const array_t<T>& a, int32 i, int32 j, int32 k) { return address(view(a, i), j, k); }

template <class T> struct memory;  // type: as it lies there; taken: of all lanes
template <> struct memory<float32> {
    typedef float type;
    INLINE static float32 taken(const char* at, int32 away)
    {
        float32 out;
        EACH(i, LANES) std::memcpy((char*)&out.v + 4 * i, at + away.v[i], 4);
        return out;
    }
};
template <> struct memory<int32> {
    typedef int type;
    INLINE static int32 taken(const char* at, int32 away)
    {
        int32 out;
        EACH(i, LANES) std::memcpy((char*)&out.v + 4 * i, at + away.v[i], 4);
        return out;
    }
};
template <> struct memory<mask> {
    typedef bool type;
    INLINE static mask taken(const char* at, int32 away)
    {
        mask out;
        EACH(i, LANES) out.v[i] = -int(*(const bool*)(at + away.v[i]));
        return out;
    }
};
template <> struct memory<uint64> {
    typedef uint64_t type;
    INLINE static uint64 taken(const char* at, int32) { return uint64{*(const uint64_t*)at}; }
};
template <int N> struct packed {
    float c[N];
};
template <int N> struct memory<vec_t<N, float32>> {
    typedef packed<N> type;
    INLINE static vec_t<N, float32> taken(const char* at, int32 away)
    {
        vec_t<N, float32> out{unset()};
        EACH(k, N) out.c[k] = memory<float32>::taken(at + 4 * k, away);
        return out;
    }
};
template <int R, int C> struct memory<mat_t<R, C, float32>> {
    typedef packed<R * C> type;
    INLINE static mat_t<R, C, float32> taken(const char* at, int32 away)
    {
        mat_t<R, C, float32> out{unset()};
        EACH(k, R * C) out.data[k / C][k % C] = memory<float32>::taken(at + 4 * k, away);
        return out;
    }
};
template <> struct memory<quat_t<float32>> {
    typedef packed<4> type;
    INLINE static quat_t<float32> taken(const char* at, int32 away)
    {
        return quat_t<float32>(
            memory<float32>::taken(at, away), memory<float32>::taken(at + 4, away), memory<float32>::taken(at + 8, away),
            memory<float32>::taken(at + 12, away)
        );
    }
};
template <class T> struct memory<array_t<T>> {  // the same for all lanes
    typedef array_t<T> type;
    INLINE static array_t<T> taken(const char* at, int32) { return *(const array_t<T>*)at; }
};

template <class T> INLINE T load(const ref<T>& r) { return memory<T>::taken(r.at, r.away); }
template <> INLINE float32 load(const ref<float32>& r)
{
    float32 out;
    if (r.in_a_row)
        std::memcpy(&out.v, r.at, sizeof out.v);
    else
        out = memory<float32>::taken(r.at, r.away);
    return out;
}
template <class T> INLINE void put(mask m, const ref<T>& r, T value)
{
    if (r.in_a_row && all(m))
        std::memcpy(r.at, &value.v, sizeof value.v);
    else
        EACH(i, LANES) if (m.v[i]) std::memcpy(r.at + r.away.v[i], (const char*)&value.v + 4 * i, 4);
}
template <class T> struct exactly {
    typedef T type;
};
template <class T> using of_array = typename exactly<T>::type;
template <class T> INLINE void array_store(mask m, const array_t<T>& a, int32 i, of_array<T> value)
{
    put(m && active, address(a, i), value);
}
template <class T> INLINE void array_store(mask m, const array_t<T>& a, int32 i, int32 j, of_array<T> value)
{
    put(m && active, address(a, i, j), value);
}
template <class T> INLINE void array_store(mask m, const array_t<T>& a, int32 i, int32 j, int32 k, of_array<T> value)
{
    put(m && active, address(a, i, j, k), value);
}
#undef EACH

}  // namespace wp
