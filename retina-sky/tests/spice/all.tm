KPL/MK
\begindata
PATH_VALUES  = ( '.' )
PATH_SYMBOLS = ( 'HERE' )
KERNELS_TO_LOAD = ( '$HERE/leap.tls' '$HERE/const+' 'ants.tpc'
                    '$HERE/axes.bpc' '$HERE/frames.tf' )
