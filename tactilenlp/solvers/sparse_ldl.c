/* L D L' of a sparse symmetric positive definite matrix, row by row, without pivoting.

   T. A. Davis, Direct Methods for Sparse Linear Systems, SIAM 2006, chapter 4.
   Matrices are stored by columns: starts (n + 1), rows, values. */

#pragma GCC optimize("O3")

/* Factorise the matrix whose upper triangle is `a`.  Column c of `l` is row c of L
   without its diagonal; d (n) are the pivots, w (n) is zero before and after.
   Returns 0, or 1 + the first column whose pivot is not positive. */
int tactilenlp_factorise(int n, const int *a_start, const int *a_row, const double *a,
                         const int *l_start, const int *l_row, double *l, double *d,
                         double *w)
{
    for (int c = 0; c < n; ++c) {
        for (int k = a_start[c]; k < a_start[c + 1]; ++k)
            w[a_row[k]] = a[k];
        double pivot = w[c];
        w[c] = 0;
        for (int k = l_start[c]; k < l_start[c + 1]; ++k) {
            double sum = w[l_row[k]];
            for (int m = l_start[l_row[k]]; m < l_start[l_row[k] + 1]; ++m)
                sum -= l[m] * w[l_row[m]];
            w[l_row[k]] = sum;
        }
        for (int k = l_start[c]; k < l_start[c + 1]; ++k) {
            double scaled = w[l_row[k]];
            w[l_row[k]] = 0;
            l[k] = scaled / d[l_row[k]];
            pivot -= l[k] * scaled;
        }
        d[c] = pivot;
        if (!(pivot > 0))
            return c + 1;
    }
    return 0;
}

/* Replace x (n) by the solution of L D L' x = x. */
static void substitute_one(int n, const int *l_start, const int *l_row,
                           const double *l, const double *d, double *x)
{
    for (int c = 0; c < n; ++c)
        for (int m = l_start[c]; m < l_start[c + 1]; ++m)
            x[c] -= l[m] * x[l_row[m]];
    for (int c = 0; c < n; ++c)
        x[c] /= d[c];
    for (int c = n - 1; c >= 0; --c)
        for (int m = l_start[c]; m < l_start[c + 1]; ++m)
            x[l_row[m]] -= l[m] * x[c];
}

/* Subtract f times one row of k numbers from another. */
static inline void subtract(int k, double f, const double *restrict from,
                            double *restrict to)
{
    for (int i = 0; i < k; ++i)
        to[i] -= f * from[i];
}

/* Replace x (n rows of k numbers) by the solutions of L D L' x = x. */
void tactilenlp_substitute(int n, const int *l_start, const int *l_row, const double *l,
                           const double *d, long k, double *x)
{
    if (k == 1) {
        substitute_one(n, l_start, l_row, l, d, x);
        return;
    }
    for (int c = 0; c < n; ++c)
        for (int m = l_start[c]; m < l_start[c + 1]; ++m)
            subtract(k, l[m], x + k * l_row[m], x + k * c);
    for (int c = 0; c < n; ++c)
        for (int i = 0; i < k; ++i)
            x[k * c + i] /= d[c];
    for (int c = n - 1; c >= 0; --c)
        for (int m = l_start[c]; m < l_start[c + 1]; ++m)
            subtract(k, l[m], x + k * c, x + k * l_row[m]);
}
