KPL/MK
\begindata
PATH_VALUES     = ( '.' )
PATH_SYMBOLS    = ( 'HERE' )
KERNELS_TO_LOAD = ( '$HERE/../leap.tls' '$HERE/craft.tsc' '$HERE/craft.tf' '$HERE/craft.bsp' '$HERE/craft.bc' )
