#version 300 es
// Shades the tables of baking.py, whatever the model: nothing here knows any.
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler2DArray;
precision highp sampler3D;

// relight.js puts the numbers of the material here.
const int TERMS = 1;
const int FACTORS = 1;
const int MOVES = 1;
const int PARAMETERS = 1;
const float PI = 3.14159265358979;
// As _SHORT in baking.py.
const float SHORT = 1e-4;

uniform sampler3D tables;
uniform sampler2D normals;
uniform sampler2DArray maps;
uniform vec3 light;
uniform vec3 exposed;  // irradiance times the scale of the screen
uniform vec3 nodes;  // over the half angle, along and across
uniform bool reciprocal;
uniform float sideNodes;
uniform int height;

uniform int terms;
uniform ivec4 ranges[TERMS];  // first factor and the one after the last, first move and the one after the last
uniform int bases[TERMS];
uniform float units[TERMS];  // of asinh
uniform float top;  // on its scale
uniform ivec2 factors[FACTORS];  // parameter, and 1 for its complement
uniform ivec2 moves[MOVES];  // parameter, and the table of its first node
uniform vec3 values[PARAMETERS];  // of one that has a map, the factor of it
uniform vec3 middles[PARAMETERS];
uniform vec3 lowers[PARAMETERS];
uniform vec3 uppers[PARAMETERS];
uniform bool logs[PARAMETERS];
uniform int layers[PARAMETERS];  // of the map; -1: none

out vec4 colour;

vec3 value(int parameter) {
  if (layers[parameter] < 0) return values[parameter];
  return values[parameter] * texelFetch(maps, ivec3(gl_FragCoord.x, height - 1 - int(gl_FragCoord.y), layers[parameter]), 0).rgb;
}

// Places of the parameter's channels among its nodes: Span.node.
vec3 node(int parameter) {
  vec3 at = value(parameter), middle = middles[parameter], low = lowers[parameter], high = uppers[parameter];
  if (logs[parameter]) {
    at = log(max(at, 1e-30));
    middle = log(middle);
    low = log(low);
    high = log(high);
  }
  vec3 side = mix(high - middle, middle - low, vec3(lessThan(at, middle)));
  vec3 share = mix(vec3(0.0), (at - middle) / side, vec3(greaterThan(side, vec3(0.0))));
  return sideNodes * (1.0 + clamp(share, -1.0, 1.0));
}

float halfAngle(float place) {
  return min(place * place * (3.0 - 2.0 * place), 1.0 - SHORT) * (PI / 2.0);
}

// Places among the nodes of the directions: coordinates() in baking.py.
vec3 place(float theta, float psi, float omega) {
  float smooth_ = 0.5 - sin(asin(clamp(1.0 - (4.0 / PI) * theta, -1.0, 1.0)) / 3.0);
  float below = clamp(floor((nodes.x - 1.0) * smooth_), 0.0, nodes.x - 2.0);
  float start = sin(halfAngle(below / (nodes.x - 1.0)));
  float end = sin(halfAngle((below + 1.0) / (nodes.x - 1.0)));
  float here = sin(theta);
  float part = clamp((here * here - start * start) / (end * end - start * start), 0.0, 1.0);
  float share = clamp(psi / max(PI / 2.0 - theta, SHORT), -1.0, 1.0);
  float side = sqrt(1.0 - abs(share));
  float along = reciprocal ? (nodes.y - 1.0) * (1.0 - side) : 0.5 * (nodes.y - 1.0) * (1.0 + sign(share) * (1.0 - side));
  return vec3(below + part, along, (nodes.z - 1.0) * clamp(omega / (PI / 2.0), 0.0, 1.0));
}

vec3 look(int table, vec3 at) {
  vec3 size = vec3(textureSize(tables, 0));
  return texture(tables, (at + vec3(0.5, 0.5, 0.5 + float(table) * nodes.z)) / size).rgb;
}

vec3 between(int first, float where_, vec3 at) {
  float below = min(floor(where_), 2.0 * sideNodes - 1.0);
  return mix(look(first + int(below), at), look(first + int(below) + 1, at), where_ - below);
}

// What a parameter adds at its place: one look where its channels have the same.
vec3 moved(ivec2 move, vec3 at) {
  vec3 where_ = node(move.x);
  vec3 red = between(move.y, where_.r, at);
  if (where_.r == where_.g && where_.r == where_.b) return red;
  return vec3(red.r, between(move.y, where_.g, at).g, between(move.y, where_.b, at).b);
}

vec3 reflectance(vec3 at) {
  vec3 total = vec3(0.0);
  for (int term = 0; term < terms; term++) {
    ivec4 range = ranges[term];
    vec3 shape = look(bases[term], at) + top;
    for (int k = range.z; k < range.w; k++) shape += moved(moves[k], at);
    vec3 amount = units[term] * sinh(shape);
    for (int k = range.x; k < range.y; k++) {
      vec3 factor = value(factors[k].x);
      amount *= factors[k].y == 1 ? 1.0 - factor : factor;
    }
    total += amount;
  }
  return max(total, 0.0);
}

vec3 srgb(vec3 linear) {
  vec3 shown = clamp(linear, 0.0, 1.0);
  return mix(1.055 * pow(max(shown, 0.0031308), vec3(1.0 / 2.4)) - 0.055, 12.92 * shown, vec3(lessThanEqual(shown, vec3(0.0031308))));
}

void main() {
  vec4 surface = texelFetch(normals, ivec2(gl_FragCoord.x, height - 1 - int(gl_FragCoord.y)), 0);
  colour = vec4(0.0);
  if (surface.w == 0.0) return;
  colour.a = 1.0;
  vec3 normal = surface.xyz;
  float cosIn = dot(normal, light), cosOut = normal.z;
  if (cosIn <= 0.0 || cosOut <= 0.0) return;
  vec3 sum = light + vec3(0.0, 0.0, 1.0), apart = light - vec3(0.0, 0.0, 1.0);
  vec3 middle = normalize(sum);
  float theta = atan(length(cross(normal, middle)), dot(normal, middle));
  float psi = atan((cosOut - cosIn) * cos(theta), max((cosOut + cosIn) * sin(theta), 1e-9));
  float cosDifference = length(sum) / 2.0, sinDifference = length(apart) / 2.0;
  float cosAcross = min(cosDifference / cos(psi), 1.0);
  float sinAcross = sqrt(max(sinDifference * sinDifference - cosAcross * cosAcross * sin(psi) * sin(psi), 0.0));
  // ψ is positive toward the light's horizon.
  vec3 at = place(theta, psi, atan(sinAcross, cosAcross));
  colour.rgb = srgb(reflectance(at) * cosIn * exposed);
}
