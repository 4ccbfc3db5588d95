import ctypes, re
exec(open('/tmp/v/hot2.py').read().split("print(run(3000))")[0])
for l in open('/proc/self/maps'):
    p=l.split()
    a,b=[int(x,16) for x in p[0].split('-')]
    if p[1]=='r-xp' and len(p)==5 and b-a==4096:
        open('/tmp/v/th.bin','wb').write(ctypes.string_at(a,4096)); print(l)
        os.system('objdump -D -b binary -m i386:x86-64 /tmp/v/th.bin | sed -n 1,60p')
