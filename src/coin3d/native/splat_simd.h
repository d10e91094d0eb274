// The few vector operations of the splat kernels that have no operator. Included once per instruction set, inside a namespace
// of its own: COIN3D_SPLAT_LANES is 16 (AVX-512), 8 (AVX2) or 4 (SSE2, NEON, anything GCC's vector types can express).

constexpr int kLanes = COIN3D_SPLAT_LANES;
typedef float Vec __attribute__((vector_size(4 * COIN3D_SPLAT_LANES)));
typedef int32_t IntVec __attribute__((vector_size(4 * COIN3D_SPLAT_LANES)));

inline Vec broadcast(float x) { return Vec{} + x; }

#if COIN3D_SPLAT_LANES == 16

using Mask = __mmask16;
inline Mask less(Vec a, Vec b) { return _mm512_cmp_ps_mask(a, b, _CMP_LT_OQ); }
inline Mask not_less(Vec a, Vec b) { return _mm512_cmp_ps_mask(a, b, _CMP_GE_OQ); }
inline Vec keep(Mask m, Vec a) { return _mm512_maskz_mov_ps(m, a); }
inline Vec choose(Mask m, Vec a, Vec b) { return _mm512_mask_blend_ps(m, b, a); }
inline Vec drop(Mask m, Vec a) { return _mm512_maskz_mov_ps(_knot_mask16(m), a); }
inline Vec smaller(Vec a, Vec b) { return _mm512_min_ps(a, b); }
inline bool all(Mask m) { return m == 0xFFFF; }

#elif COIN3D_SPLAT_LANES == 8

using Mask = __m256;
inline Mask less(Vec a, Vec b) { return _mm256_cmp_ps(a, b, _CMP_LT_OQ); }
inline Mask not_less(Vec a, Vec b) { return _mm256_cmp_ps(a, b, _CMP_GE_OQ); }
inline Vec keep(Mask m, Vec a) { return _mm256_and_ps(m, a); }
inline Vec choose(Mask m, Vec a, Vec b) { return _mm256_blendv_ps(b, a, m); }
inline Vec drop(Mask m, Vec a) { return _mm256_andnot_ps(m, a); }
inline Vec smaller(Vec a, Vec b) { return _mm256_min_ps(a, b); }
inline bool all(Mask m) { return _mm256_movemask_ps(m) == 0xFF; }

#else

using Mask = IntVec;
inline Mask less(Vec a, Vec b) { return a < b; }
inline Mask not_less(Vec a, Vec b) { return a >= b; }
inline Vec keep(Mask m, Vec a) { return (Vec)(m & (IntVec)a); }
inline Vec choose(Mask m, Vec a, Vec b) { return (Vec)((m & (IntVec)a) | (~m & (IntVec)b)); }
inline Vec drop(Mask m, Vec a) { return (Vec)(~m & (IntVec)a); }
inline Vec smaller(Vec a, Vec b) { return choose(a < b, a, b); }
inline bool all(Mask m) { return (m[0] & m[1] & m[2] & m[3]) != 0; }

#endif

// 2^x for -126 < x < 126, relative error 3e-6: whole part into the exponent, polynomial for the rest.
inline Vec exp2_near_zero(Vec x) {
  const Vec magic = broadcast(12582912.f);  // 1.5 * 2^23: adding it rounds to a whole number in the low bits
  const Vec whole = x + magic;
  const Vec f = x - (whole - magic);
  Vec p = broadcast(0.009560510516166687f);
  p = p * f + 0.05591703951358795f;
  p = p * f + 0.24024981260299683f;
  p = p * f + 0.6931219696998596f;
  p = p * f + 0.9999991655349731f;
  return (Vec)((IntVec)p + ((IntVec)whole << 23));
}
