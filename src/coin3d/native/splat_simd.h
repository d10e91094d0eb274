// The few vector operations of the splat kernels that have no operator. Included once per instruction set, inside a namespace
// of its own: COIN3D_SPLAT_LANES is 16 (AVX-512), 8 (AVX2) or 4 (SSE2, NEON, anything GCC's vector types can express).

constexpr int kLanes = COIN3D_SPLAT_LANES;
typedef float Vec __attribute__((vector_size(4 * COIN3D_SPLAT_LANES)));
typedef int32_t IntVec __attribute__((vector_size(4 * COIN3D_SPLAT_LANES)));

#if COIN3D_SPLAT_LANES == 16

using Mask = __mmask16;
inline Vec broadcast(float x) { return _mm512_set1_ps(x); }
inline Mask less(Vec a, Vec b) { return _mm512_cmp_ps_mask(a, b, _CMP_LT_OQ); }
inline Mask not_less(Vec a, Vec b) { return _mm512_cmp_ps_mask(a, b, _CMP_GE_OQ); }
inline Vec keep(Mask m, Vec a) { return _mm512_maskz_mov_ps(m, a); }
inline Vec choose(Mask m, Vec a, Vec b) { return _mm512_mask_blend_ps(m, b, a); }
inline Vec product_unless(Mask m, Vec a, Vec b) { return _mm512_maskz_mul_ps(_knot_mask16(m), a, b); }
inline Vec minus_product(Vec c, Vec a, Vec b) { return _mm512_fnmadd_ps(a, b, c); }
inline Vec smaller(Vec a, Vec b) { return _mm512_min_ps(a, b); }
inline bool all(Mask m) { return m == 0xFFFF; }

#elif COIN3D_SPLAT_LANES == 8

using Mask = __m256;
inline Vec broadcast(float x) { return _mm256_set1_ps(x); }
inline Mask less(Vec a, Vec b) { return _mm256_cmp_ps(a, b, _CMP_LT_OQ); }
inline Mask not_less(Vec a, Vec b) { return _mm256_cmp_ps(a, b, _CMP_GE_OQ); }
inline Vec keep(Mask m, Vec a) { return _mm256_and_ps(m, a); }
inline Vec choose(Mask m, Vec a, Vec b) { return _mm256_blendv_ps(b, a, m); }
inline Vec product_unless(Mask m, Vec a, Vec b) { return _mm256_andnot_ps(m, a * b); }
inline Vec minus_product(Vec c, Vec a, Vec b) { return _mm256_fnmadd_ps(a, b, c); }
inline Vec smaller(Vec a, Vec b) { return _mm256_min_ps(a, b); }
inline bool all(Mask m) { return _mm256_movemask_ps(m) == 0xFF; }

#else

using Mask = IntVec;
inline Vec broadcast(float x) { return Vec{x, x, x, x}; }
inline Mask less(Vec a, Vec b) { return a < b; }
inline Mask not_less(Vec a, Vec b) { return a >= b; }
inline Vec keep(Mask m, Vec a) { return (Vec)(m & (IntVec)a); }
inline Vec choose(Mask m, Vec a, Vec b) { return (Vec)((m & (IntVec)a) | (~m & (IntVec)b)); }
inline Vec product_unless(Mask m, Vec a, Vec b) { return (Vec)(~m & (IntVec)(a * b)); }
inline Vec minus_product(Vec c, Vec a, Vec b) { return c - a * b; }
inline Vec smaller(Vec a, Vec b) { return choose(a < b, a, b); }
inline bool all(Mask m) { return (m[0] & m[1] & m[2] & m[3]) != 0; }

#endif

// 2^(8 y) for -1 <= y <= 0 with a relative error of 2e-5; beyond that any number.
inline Vec exp2_eightfold(Vec y) {
  Vec p = broadcast(0.006760301534086466f);
  p = p * y + 0.05305992066860199f;
  p = p * y + 0.2393316924571991f;
  p = p * y + 0.6930281519889832f;
  p = p * y + 0.9999973177909851f;
  p = p * p;
  p = p * p;
  return p * p;
}
