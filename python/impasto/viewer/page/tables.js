// GLSL of the tables of an environment: how they are made, and how the shader of a tile looks them up.

// Of widths, half an octave apart: the first, how many, and how a hemisphere is spread on a table; wide ones up to a
// level need a quarter or a half of its side.
export const LEVELS = {
  "torrance-sparrow": { first: 1.25, step: Math.SQRT1_2, count: 14, spread: 0.25, quarter: 5, half: 9 },
  lafortune: { first: 0.5, step: Math.SQRT2, count: 24, spread: 2, quarter: 4, half: 10 },
};
export const EVEN = 2; // the spread of irradiance

// One triangle over all texels.
export const TRIANGLE = `void main() {
  gl_Position = vec4(2.0 * vec2(float((gl_VertexID << 1) & 2), float(gl_VertexID & 2)) - 1.0, 0.0, 1.0);`;
export const VERTEX_OF_TABLE = `#version 300 es
${TRIANGLE}
}`;

// A direction's place on a table, and back: its stereographic projection, denser in the middle.
export const PROJECTED = `
vec2 projected(vec3 direction, float spread) {
  vec2 s = direction.xy / max(1.0 + direction.z, 1e-3);
  return 0.5 + 0.5 * s * (1.0 + spread) / (length(s) + spread);
}`;
const HEADER = `#version 300 es
precision highp float;
uniform float uSide;
uniform float uSpread;
vec3 direction() {
  vec2 p = 2.0 * gl_FragCoord.xy / uSide - 1.0;
  float r = min(length(p), 1.0 + 0.5 * uSpread);
  vec2 s = p * (uSpread / (1.0 + uSpread - r));
  if (length(p) > r) s *= r / length(p);
  float square = dot(s, s);
  return vec3(2.0 * s, 1.0 - square) / (1.0 + square);
}`;

export const irradiance = coated => `${HEADER}
uniform highp sampler2D uTexels;   // directions, and below them their light
uniform int uCount;
uniform float uIndex;
uniform float uCoatScale;
out vec4 found;
${coated}
void main() {
  vec3 n = direction(), sum = vec3(0.0);
  for (int i = 0; i < uCount; i++) {
    float cosine = max(dot(n, texelFetch(uTexels, ivec2(i, 0), 0).xyz), 0.0);
    ${coated ? "cosine *= transmission(cosine);" : ""}
    sum += cosine * texelFetch(uTexels, ivec2(i, 1), 0).rgb;
  }
  found = vec4(sum, 1.0);
}`;

const SAMPLED = `${HEADER}
precision highp samplerCube;
uniform samplerCube uMap;
uniform mat3 uRoom;      // from the painting to the room
uniform float uScale;
uniform float uTexel;    // solid angle of a texel of the map
uniform int uSamples;
uniform float uWidth;
uniform vec3 uView;
uniform highp sampler2D uTexels;   // directions of lamps, and below them their light
uniform int uCount;
const float GOLDEN = 2.399963229728653;
mat3 frame(vec3 n) {
  vec3 side = normalize(abs(n.x) > 0.7 ? vec3(n.z, 0.0, -n.x) : vec3(0.0, n.z, -n.y));
  return mat3(side, cross(n, side), n);
}
// Radiance from around u within a solid angle; none from behind the wall.
vec3 radiance(vec3 u, float extent) {
  float above = clamp(0.5 + u.z / sqrt(max(extent, uTexel)), 0.0, 1.0);
  return above * uScale * textureLod(uMap, uRoom * u, max(0.5 * log2(extent / uTexel), 0.0)).rgb;
}`;

export const facets = fresnel => `${SAMPLED}
uniform float uIndex;
out vec4 found;
${fresnel}
void main() {
  vec3 n = direction(), sum = vec3(0.0);
  float n_v = dot(n, uView);
  mat3 axes = frame(n);
  // Facets lean by up to 1.55 rad, drawn as their distribution D says.
  float variance = uWidth * uWidth / 0.6931471805599453, kept = 1.0 - exp(-1.55 * 1.55 / variance);
  for (int i = 0; i < uSamples; i++) {
    float d = 1.0 - kept * (float(i) + 0.5) / float(uSamples);
    float phi = sqrt(max(-variance * log(d), 1e-12)), at = GOLDEN * float(i);
    vec3 h = axes * vec3(sin(phi) * cos(at), sin(phi) * sin(at), cos(phi));
    float v_h = dot(uView, h);
    vec3 u = 2.0 * v_h * h - uView;
    float n_l = dot(n, u);
    if (v_h <= 0.0 || n_l <= 0.0 || n_v <= 0.0) continue;
    float masked = 2.0 * dot(n, h) / v_h;
    float attenuation = min(min(1.0 / n_v, masked), masked * n_l / n_v);
    float whole = 3.141592653589793 * variance * kept * sin(phi) / phi; // D over its density
    float extent = 4.0 * v_h * whole / (d * float(uSamples));
    sum += radiance(u, extent) * (fresnel(v_h) * attenuation * 4.0 * v_h * whole);
  }
  sum /= float(uSamples);
  for (int i = 0; i < uCount; i++) {
    vec3 u = texelFetch(uTexels, ivec2(i, 0), 0).xyz, h = normalize(u + uView);
    float v_h = dot(uView, h), n_l = dot(n, u), masked = 2.0 * dot(n, h) / v_h;
    float phi = 2.0 * asin(min(0.5 * length(n - h), 1.0));
    float attenuation = min(min(1.0 / n_v, masked), masked * n_l / n_v);
    if (n_l > 0.0 && n_v > 0.0) sum += texelFetch(uTexels, ivec2(i, 1), 0).rgb * (fresnel(v_h) * attenuation * exp(-min(phi * phi / variance, 87.0)));
  }
  found = vec4(sum / uWidth, 1.0);
}`;

export const VECTORS = `${SAMPLED}
layout(location = 0) out vec4 across;
layout(location = 1) out vec4 upwards;
layout(location = 2) out vec4 ahead;
void main() {
  vec3 p = direction(), x = vec3(0.0), y = vec3(0.0), z = vec3(0.0);
  mat3 axes = frame(p);
  for (int i = 0; i < uSamples; i++) {
    float share = (float(i) + 0.5) / float(uSamples);
    float cosine = pow(share, 1.0 / (uWidth + 1.0)), sine = sqrt(max(1.0 - cosine * cosine, 0.0)), at = GOLDEN * float(i);
    vec3 u = axes * vec3(sine * cos(at), sine * sin(at), cosine);
    float extent = 6.283185307179586 / ((uWidth + 1.0) * max(pow(cosine, uWidth), 1e-4) * float(uSamples));
    vec3 light = radiance(u, min(extent, 3.0));
    x += u.x * light;
    y += u.y * light;
    z += u.z * light;
  }
  float factor = 6.283185307179586 * (uWidth + 2.0) / ((uWidth + 1.0) * float(uSamples));
  x *= factor;
  y *= factor;
  z *= factor;
  for (int i = 0; i < uCount; i++) {
    vec3 u = texelFetch(uTexels, ivec2(i, 0), 0).xyz;
    float cosine = max(dot(p, u), 1e-9);
    vec3 light = texelFetch(uTexels, ivec2(i, 1), 0).rgb * ((uWidth + 2.0) * exp(max(uWidth * log(cosine), -60.0)));
    x += u.x * light;
    y += u.y * light;
    z += u.z * light;
  }
  across = vec4(x, 1.0);
  upwards = vec4(y, 1.0);
  ahead = vec4(z, 1.0);
}`;

const LAST = { facets: LEVELS["torrance-sparrow"].count - 1, vectors: LEVELS.lafortune.count - 1 };

// Which part of the side of a level's table is used, in GLSL.
const part = model => `(at < ${LEVELS[model].quarter - 0.5} ? 0.25 : at < ${LEVELS[model].half - 0.5} ? 0.5 : 1.0)`;

// GLSL that looks tables up: what a lobe of unit strength reflects of each channel.
export const LOOKUPS = {
  "torrance-sparrow": `
vec3 level(float at) {
  return texture(uLobes0, vec3(place * ${part("torrance-sparrow")}, at)).rgb;
}
vec3 reflected(float gamma, float b, float c) {
  float kept = clamp(gamma, ${(1.25 * Math.SQRT1_2 ** LAST.facets).toFixed(9)}, 1.25), narrow = min(max(gamma, 5e-4) / kept, 1.0);
  float at = clamp(2.0 * log2(1.25 / kept), 0.0, ${LAST.facets}.0), first = min(floor(at), ${LAST.facets - 1}.0), t = at - first;
  // Through four levels [keys1981cubic]; the ends are repeated.
  vec3 a = level(max(first - 1.0, 0.0)), f = level(first), g = level(first + 1.0), e = level(min(first + 2.0, ${LAST.facets}.0));
  vec3 value = f + 0.5 * t * (g - a + t * (2.0 * a - 5.0 * f + 4.0 * g - e + t * (3.0 * (f - g) + e - a)));
  return kept * narrow * narrow * max(value, 0.0);
}`,
  lafortune: `
float part(float at) {
  return ${part("lafortune")};
}
vec3 reflected(float cxy, float cz, float exponent) {
  float n_v = dot(n, view), square = cxy * cxy + (cz * cz - cxy * cxy) * n_v * n_v;
  if (n_v <= 0.0 || square < 1e-17) return vec3(0.0);
  vec3 p = normalize(cxy * view + (cz - cxy) * n_v * n);
  float at = clamp(2.0 * log2(max(exponent, 0.5) / 0.5), 0.0, ${LAST.vectors}.0), first = min(floor(at), ${LAST.vectors - 1}.0), t = at - first;
  vec2 on = projected(p, ${LEVELS.lafortune.spread.toFixed(1)});
  float here = part(first), next = part(first + 1.0);
  vec3 x = mix(texture(uLobes0, vec3(on * here, first)).rgb, texture(uLobes0, vec3(on * next, first + 1.0)).rgb, t);
  vec3 y = mix(texture(uLobes1, vec3(on * here, first)).rgb, texture(uLobes1, vec3(on * next, first + 1.0)).rgb, t);
  vec3 z = mix(texture(uLobes2, vec3(on * here, first)).rgb, texture(uLobes2, vec3(on * next, first + 1.0)).rgb, t);
  float power = exp(clamp(exponent * 0.5 * naturalLogarithm(square), -60.0, 40.0));
  return power / (exponent + 2.0) * max(n.x * x + n.y * y + n.z * z, 0.0);
}`,
};
export const SPREADS = { irradiance: EVEN, lobes: LEVELS["torrance-sparrow"].spread };
