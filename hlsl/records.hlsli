// Arrays that shaders only read: texel buffers, because lavapipe reads those several times as fast as structured buffers, and
// faster than pictures, for whose texels it works out a mip in every lane. Where devices allow none that are large, STORAGE.

#ifndef THRONG_RECORDS
#define THRONG_RECORDS

#ifdef STORAGE
#define RECORDS(T) StructuredBuffer<T>
#else
#define RECORDS(T) Buffer<T>
#endif

#endif
