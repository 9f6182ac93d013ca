cd /work/scratch/eigl
for c in "quadruped-1k 100" "quadruped-1k 300" "creature-5k 100" "creature-10k 100" "creature-10k 300" "creature-43k 100"; do set -- $c; for t in 1 2; do timeout 100 target/release/solve /work/brief/operators/$1.operator $2 $t 5 | grep -v HWM | sed "s/.*operator//" ; done; done
